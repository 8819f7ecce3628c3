//! Precision modes by name, for the command line and the studies.

use std::fmt;
use std::str::FromStr;

use pairmask::precision::Widening;
use pairmask::session::Margin;
use pairmask::{Aabb, Bounds, Precision};

/// The modes by name. The names are part of the command line's contract.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PrecisionChoice {
    /// f32 boxes, no extra pair.
    #[default]
    Exact,
    /// 16-bit cells of the bounds of the boxes.
    Q16,
    /// 8-bit cells of the bounds of the boxes.
    Q8,
    /// Halves.
    F16,
    /// f32 boxes, inflated.
    Margin(Margin),
}

/// What stands before the number of a margin.
const MARGIN_PREFIX: &str = "margin=";

impl PrecisionChoice {
    /// The name without the number.
    pub const fn mode(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Q16 => "q16",
            Self::Q8 => "q8",
            Self::F16 => "f16",
            Self::Margin(_) => "margin",
        }
    }

    /// The precision in which boxes are sent; bounds are those of `boxes`.
    pub fn precision(self, boxes: &[Aabb]) -> Precision {
        match self {
            Self::Exact | Self::Margin(_) => Precision::Exact,
            Self::Q16 => Precision::Q16(Bounds::around(boxes)),
            Self::Q8 => Precision::Q8(Bounds::around(boxes)),
            Self::F16 => Precision::F16,
        }
    }

    /// Boxes as they are to be sent.
    pub fn inflate(self, boxes: &mut [Aabb]) {
        if let Self::Margin(margin) = self {
            for b in boxes {
                *b = margin.inflate(b);
            }
        }
    }

    /// The gap on each axis below which boxes may be reported as a pair, where that is the same
    /// all over the scene. `widening` is that of the form that was used.
    pub fn gap_below(self, widening: &Widening) -> Option<[f64; 3]> {
        match (self, widening) {
            (Self::Margin(margin), _) => Some([2.0 * f64::from(margin.get()); 3]),
            (_, Widening::None) => Some([0.0; 3]),
            (_, Widening::Cells(cell)) => Some(*cell),
            (_, Widening::Relative { .. }) => None,
        }
    }
}

impl fmt::Display for PrecisionChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Margin(margin) => write!(f, "{MARGIN_PREFIX}{}", margin.get()),
            named => f.write_str(named.mode()),
        }
    }
}

/// A name that is no precision.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no precision: choose one of exact, q16, q8, f16, margin=X with X >= 0 in units")]
pub struct UnknownPrecision(String);

impl FromStr for PrecisionChoice {
    type Err = UnknownPrecision;

    fn from_str(s: &str) -> Result<Self, UnknownPrecision> {
        let margin = || Margin::new(s.strip_prefix(MARGIN_PREFIX)?.parse().ok()?).ok();
        match s {
            "exact" => Ok(Self::Exact),
            "q16" => Ok(Self::Q16),
            "q8" => Ok(Self::Q8),
            "f16" => Ok(Self::F16),
            _ => margin().map(Self::Margin).ok_or_else(|| UnknownPrecision(s.to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back() {
        for name in ["exact", "q16", "q8", "f16", "margin=0", "margin=0.25"] {
            let parsed = name.parse::<PrecisionChoice>();
            assert_eq!(parsed.map(|p| p.to_string()).as_deref(), Ok(name));
        }
        for wrong in ["q17", "", "margin", "margin=", "margin=-1", "margin=inf", "margin=nan"] {
            assert!(wrong.parse::<PrecisionChoice>().is_err(), "{wrong}");
        }
    }
}
