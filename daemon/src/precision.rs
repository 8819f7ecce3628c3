//! Precision modes by name, for the command line and the studies.

use std::fmt;
use std::str::FromStr;

use pairmask_core::precision::{BoxSlice, ExpandScratch, Margin, Widening};
use pairmask_core::{Aabb, Bounds, Precision};

/// The modes by name. The names are part of the command line's contract.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PrecisionChoice {
    #[default]
    Exact,
    /// 16-bit cells of the bounds of the boxes.
    Q16,
    /// 8-bit cells of the bounds of the boxes.
    Q8,
    F16,
    /// f32 boxes, inflated.
    Margin(Margin),
}

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

    pub fn inflate(self, boxes: &mut [Aabb]) {
        if let Self::Margin(margin) = self {
            for b in boxes {
                *b = margin.inflate(b);
            }
        }
    }

    /// The gap on each axis up to which boxes within `world` may be reported as a pair, where one number
    /// states it. `widening` is that of the form in use; `world` is the bounds of the boxes.
    pub fn gap_below(self, widening: &Widening, world: &Bounds) -> Option<[f64; 3]> {
        match (self, widening) {
            (Self::Margin(margin), _) => {
                // Steps of f32 are largest at the face that is farthest from 0.
                let (low, high) = (world.low(), world.high());
                let gap = |axis: usize| {
                    let far = f64::from(low[axis].abs().max(high[axis].abs()));
                    margin.gap_limit(widening, axis, far, far)
                };
                Some(std::array::from_fn(gap))
            }
            (_, Widening::None) => Some([0.0; 3]),
            (_, Widening::Cells { size, .. }) => Some(*size),
            (_, Widening::Relative { .. } | Widening::Origin(_)) => None,
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

/// The f32 boxes that engines get for `boxes` sent with a precision.
///
/// # Panics
/// When the system has no memory for the boxes.
pub fn as_sent(precision: &Precision, boxes: &[Aabb]) -> Vec<Aabb> {
    let bytes = boxes.len() * precision.form().box_bytes();
    // Allocated as words: narrow boxes need more than byte alignment.
    let mut words = vec![0u32; bytes.div_ceil(size_of::<u32>())];
    let memory: &mut [u8] = &mut bytemuck::cast_slice_mut(&mut words)[..bytes];
    precision.write(boxes, memory);
    let mut scratch = ExpandScratch::default();
    let narrow = BoxSlice::new(precision.form(), memory).expect("whole boxes, aligned");
    narrow.expand(&mut scratch, false).as_f32().expect("expanded to f32").to_vec()
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no precision: choose one of exact, q16, q8, f16, margin=X with X >= 0 in units")]
pub struct UnknownPrecision(String);

impl FromStr for PrecisionChoice {
    type Err = UnknownPrecision;

    fn from_str(s: &str) -> Result<Self, UnknownPrecision> {
        let margin = || Margin::new(s.strip_prefix(MARGIN_PREFIX)?.parse().ok()?).ok();
        let named = [Self::Exact, Self::Q16, Self::Q8, Self::F16];
        let named = named.into_iter().find(|choice| choice.mode() == s);
        let choice = named.or_else(|| margin().map(Self::Margin));
        choice.ok_or_else(|| UnknownPrecision(s.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gap_of_a_margin_has_the_steps_of_f32_at_the_scene() {
        let far = [0.0f32, 0.125].map(|gap| Aabb::from([1e6, 0.0, 0.0, 1e6 + gap, 1.0, 1.0]));
        let apart = Aabb::from([1e6 + 0.25, 0.0, 0.0, 1e6 + 1.0, 1.0, 1.0]);
        let choice: PrecisionChoice = "margin=0.001".parse().expect("a margin");
        let mut sent = [far[1], apart];
        choice.inflate(&mut sent);
        assert!(sent[0].overlaps(&sent[1]), "an eighth of a unit apart, sixty times both margins");
        let world = Bounds::around(&[far[0], far[1], apart]);
        let gap = choice.gap_below(&Widening::None, &world).expect("a number");
        assert!(gap[0] >= 0.125, "{gap:?}");
        assert!((0.002..0.0021).contains(&gap[1]), "{gap:?}");
    }
}
