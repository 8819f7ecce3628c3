//! The subjects of rows: a precision mode of the sessions, or one of three others.
//!
//! The others: the scene in a world of f64 coordinates, far from their origin; the same rounded to
//! the nearest f32, as is often done; and bounding spheres in place of the boxes.

use std::fmt;
use std::str::FromStr;

use pairmaskd::precision::{PrecisionChoice, UnknownPrecision};

/// A value of `--precision`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StudyMode {
    /// The scene's boxes in a precision.
    Sent(PrecisionChoice),
    /// The scene moved away from the origin of a world in f64.
    World(World),
    /// Spheres of the scene's boxes.
    Spheres(Fit),
}

/// A world in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct World {
    /// How far from the origin the scene lies on every axis, units.
    pub offset: f64,
    /// How its boxes become f32.
    pub rounding: Rounding,
}

/// How boxes of a world become f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// Relative to an origin among them, outward ([`pairmask_core::Aabb::outward_from_f64`]).
    ByOrigin,
    /// To the nearest f32, as they are.
    Plain,
}

/// How a sphere stands for a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// Around the box: boxes that overlap have spheres that overlap.
    Circumscribed,
    /// Within the box: spheres that overlap have boxes that overlap.
    Inscribed,
}

impl Fit {
    const ALL: [Self; 2] = [Self::Circumscribed, Self::Inscribed];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Circumscribed => "circumscribed",
            Self::Inscribed => "inscribed",
        }
    }
}

/// Default distance from the origin: steps of f32 are 64 units there.
const FAR: f64 = 1e9;

const F64: &str = "f64";
/// The name of [`Rounding::Plain`].
pub(super) const PLAIN_F32: &str = "plain-f32";
const SPHERES: &str = "spheres";

impl StudyMode {
    /// The name without the number.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sent(precision) => precision.mode(),
            Self::World(World { rounding: Rounding::ByOrigin, .. }) => F64,
            Self::World(World { rounding: Rounding::Plain, .. }) => PLAIN_F32,
            Self::Spheres(_) => SPHERES,
        }
    }
}

impl fmt::Display for StudyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sent(precision) => precision.fmt(f),
            Self::World(world) => write!(f, "{}={:e}", self.name(), world.offset),
            Self::Spheres(fit) => write!(f, "{SPHERES}={}", fit.as_str()),
        }
    }
}

/// A name that is no mode of the study.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{0}' is no mode: choose one of exact, q16, q8, f16, margin=X with X >= 0 in units, f64=X and plain-f32=X with X >= 0 units from the origin, spheres=circumscribed, spheres=inscribed"
)]
pub struct UnknownMode(String);

impl FromStr for StudyMode {
    type Err = UnknownMode;

    fn from_str(s: &str) -> Result<Self, UnknownMode> {
        let unknown = || UnknownMode(s.to_owned());
        let (name, value) = s.split_once('=').map_or((s, None), |(name, v)| (name, Some(v)));
        let world = |rounding| {
            let offset = value.map_or(Ok(FAR), str::parse).map_err(|_| unknown())?;
            let is_distance = offset >= 0.0 && offset.is_finite();
            is_distance.then_some(Self::World(World { offset, rounding })).ok_or_else(unknown)
        };
        match name {
            F64 => world(Rounding::ByOrigin),
            PLAIN_F32 => world(Rounding::Plain),
            SPHERES => {
                let named = value.unwrap_or(Fit::Circumscribed.as_str());
                let fit = Fit::ALL.into_iter().find(|fit| fit.as_str() == named);
                fit.map(Self::Spheres).ok_or_else(unknown)
            }
            _ => s.parse().map(Self::Sent).map_err(|_: UnknownPrecision| unknown()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back() {
        for name in [
            "exact",
            "q8",
            "margin=0.25",
            "f64=1e9",
            "plain-f32=1.5e6",
            "f64=0e0",
            "spheres=inscribed",
        ] {
            let mode = name.parse::<StudyMode>();
            assert_eq!(mode.as_ref().map(ToString::to_string).as_deref(), Ok(name));
            assert!(name.starts_with(mode.map_or("", StudyMode::name)), "{name}");
        }
        for (short, long) in [
            ("f64", "f64=1e9"),
            ("plain-f32", "plain-f32=1e9"),
            ("spheres", "spheres=circumscribed"),
        ] {
            assert_eq!(short.parse::<StudyMode>(), long.parse());
        }
        for wrong in ["", "f64=", "f64=-1", "f64=inf", "plain-f32=nan", "spheres=cubic", "q17"] {
            assert!(wrong.parse::<StudyMode>().is_err(), "{wrong}");
        }
    }
}
