//! The subjects of rows: a precision mode of the sessions, or one of three others.

use std::fmt;
use std::str::FromStr;

use pairmaskd::precision::{PrecisionChoice, UnknownPrecision};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StudyMode {
    Sent(PrecisionChoice),
    /// The scene in a world of f64 coordinates, so many units from its origin on every axis. Its boxes become f32
    /// relative to an origin among them, outward ([`pairmask_core::Aabb::outward_from_f64`]).
    F64(f64),
    /// The same, with boxes rounded to the nearest f32 as they are, which is often done, and a warning.
    PlainF32(f64),
    /// Spheres around the boxes: boxes that overlap have spheres that overlap.
    Spheres,
}

/// Default distance from the origin: steps of f32 are 64 units there.
const FAR: f64 = 1e9;

/// What spheres are to the boxes, in reports.
pub(super) const CIRCUMSCRIBED: &str = "circumscribed";

impl StudyMode {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sent(precision) => precision.mode(),
            Self::F64(_) => "f64",
            Self::PlainF32(_) => "plain-f32",
            Self::Spheres => "spheres",
        }
    }
}

impl fmt::Display for StudyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sent(precision) => precision.fmt(f),
            Self::F64(offset) | Self::PlainF32(offset) => write!(f, "{}={offset:e}", self.name()),
            Self::Spheres => write!(f, "spheres={CIRCUMSCRIBED}"),
        }
    }
}

impl FromStr for StudyMode {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let (name, value) = s.split_once('=').map_or((s, None), |(name, v)| (name, Some(v)));
        let mode = match (name, value) {
            ("f64" | "plain-f32", _) => {
                let offset = value.map_or(Some(FAR), |value| value.parse().ok());
                let offset = offset.filter(|offset| *offset >= 0.0 && offset.is_finite());
                offset.map(if name == "f64" { Self::F64 } else { Self::PlainF32 })
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
        for name in ["exact", "margin=0.25", "plain-f32=1.5e6", "f64=0e0", "spheres=circumscribed"]
        {
            let mode = name.parse::<StudyMode>();
            assert_eq!(mode.map(|mode| mode.to_string()).as_deref(), Ok(name));
        }
        for wrong in ["", "f64=", "f64=-1", "f64=inf", "plain-f32=nan", "spheres=cubic", "q17"] {
            assert!(wrong.parse::<StudyMode>().is_err(), "{wrong}");
        }
    }
}
