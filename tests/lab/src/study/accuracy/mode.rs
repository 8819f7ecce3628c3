//! The subjects of rows: a precision mode of the sessions, or one of three others.
//!
//! The others: the scene in a world of f64 coordinates, far from their origin; the same rounded to
//! the nearest f32, as is often done; and spheres around the boxes in place of them.

use std::fmt;
use std::str::FromStr;

use pairmaskd::precision::{PrecisionChoice, UnknownPrecision};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StudyMode {
    Sent(PrecisionChoice),
    /// The scene moved away from the origin of a world in f64.
    World(World),
    /// Spheres around the boxes: boxes that overlap have spheres that overlap.
    Spheres,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct World {
    /// How far from the origin the scene lies on every axis, units.
    pub offset: f64,
    /// Whether its boxes become f32 by rounding to the nearest, as they are; else relative to an origin among them,
    /// outward ([`pairmask_core::Aabb::outward_from_f64`]).
    pub is_plain: bool,
}

/// Default distance from the origin: steps of f32 are 64 units there.
const FAR: f64 = 1e9;

/// What spheres are to the boxes, in reports.
pub(super) const CIRCUMSCRIBED: &str = "circumscribed";

/// The mode that is a warning.
pub(super) const PLAIN_F32: &str = "plain-f32";

impl StudyMode {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sent(precision) => precision.mode(),
            Self::World(World { is_plain: false, .. }) => "f64",
            Self::World(World { is_plain: true, .. }) => PLAIN_F32,
            Self::Spheres => "spheres",
        }
    }
}

impl fmt::Display for StudyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sent(precision) => precision.fmt(f),
            Self::World(world) => write!(f, "{}={:e}", self.name(), world.offset),
            Self::Spheres => write!(f, "spheres={CIRCUMSCRIBED}"),
        }
    }
}

impl FromStr for StudyMode {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let (name, value) = s.split_once('=').map_or((s, None), |(name, v)| (name, Some(v)));
        let mode = match (name, value) {
            ("f64" | PLAIN_F32, _) => {
                let offset = value.map_or(Some(FAR), |value| value.parse().ok());
                let offset = offset.filter(|offset| *offset >= 0.0 && offset.is_finite());
                offset.map(|offset| Self::World(World { offset, is_plain: name == PLAIN_F32 }))
            }
            ("spheres", None | Some(CIRCUMSCRIBED)) => Some(Self::Spheres),
            ("spheres", _) => None,
            _ => s.parse().map(Self::Sent).map_err(|_: UnknownPrecision| ()).ok(),
        };
        mode.ok_or_else(|| {
            format!(
                "'{s}' is no mode: choose one of exact, q16, q8, f16, margin=X with X >= 0 in units, \
                 f64=X and plain-f32=X with X >= 0 units from the origin, spheres"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back() {
        for (name, long) in [
            ("exact", "exact"),
            ("margin=0.25", "margin=0.25"),
            ("plain-f32=1.5e6", "plain-f32=1.5e6"),
            ("f64=0e0", "f64=0e0"),
            ("f64", "f64=1e9"),
            ("plain-f32", "plain-f32=1e9"),
            ("spheres", "spheres=circumscribed"),
        ] {
            let mode = name.parse::<StudyMode>();
            assert_eq!(mode.as_ref().map(ToString::to_string).as_deref(), Ok(long));
            assert!(name.starts_with(mode.map_or("", StudyMode::name)), "{name}");
        }
        for wrong in ["", "f64=", "f64=-1", "f64=inf", "plain-f32=nan", "spheres=cubic", "q17"] {
            assert!(wrong.parse::<StudyMode>().is_err(), "{wrong}");
        }
    }
}
