//! World bounds: within them quantised boxes keep their positions to a cell.
//!
//! Corners are compared as integer keys, so that the bounds do not depend on the denormal flags of
//! threads.

use rayon::prelude::*;

use crate::aabb::{Aabb, BoxClass, KeyBox, coordinate, order_key};

/// Boxes that one task of [`Bounds::around`] reads: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;

const FINITE_KEYS: std::ops::RangeInclusive<i32> =
    order_key(f32::MIN.to_bits())..=order_key(f32::MAX.to_bits());

/// Finite world bounds, `low <= high` on every axis.
///
/// Coordinates outside count as lying in the outermost cells. No pair is lost, but two boxes
/// outside on the same side overlap on that axis, however far they are from each other. On an axis
/// where `low == high` all boxes overlap.
///
/// ```
/// use pairmask_core::precision::Bounds;
/// let world = Bounds::new([-500.0; 3], [500.0; 3])?;
/// assert!(Bounds::new([1.0; 3], [0.0; 3]).is_err());
/// # Ok::<(), pairmask_core::precision::BoundsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

/// Why two corners are refused as bounds.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "bounds from {low} to {high} on axis {axis}: give finite corners, the lower one first, or Bounds::around the boxes"
)]
pub struct BoundsError {
    /// 0, 1 or 2.
    pub axis: usize,
    /// The lower corner there.
    pub low: f32,
    /// The higher corner there.
    pub high: f32,
}

impl Bounds {
    /// The bounds between two corners.
    ///
    /// # Errors
    /// [`BoundsError`] names the first axis that is infinite, NaN or the wrong way round.
    pub fn new(low: impl Into<[f32; 3]>, high: impl Into<[f32; 3]>) -> Result<Self, BoundsError> {
        let (low, high) = (low.into(), high.into());
        for axis in 0..3 {
            let (low, high) = (low[axis], high[axis]);
            let in_order = order_key(low.to_bits()) <= order_key(high.to_bits());
            if !(low.is_finite() && high.is_finite() && in_order) {
                return Err(BoundsError { axis, low, high });
            }
        }
        Ok(Self { low, high })
    }

    /// The tightest bounds around the finite coordinates of the valid boxes; a point at the origin
    /// where there are none. Reads every box, large scenes on the rayon pool.
    pub fn around(boxes: &[Aabb]) -> Self {
        let of = |boxes: &[Aabb]| boxes.iter().fold(Extremes::NONE, Extremes::with);
        let found =
            boxes.par_chunks(TASK_BOXES).map(of).reduce(|| Extremes::NONE, |a, b| a.joined(&b));
        let Extremes { low, high } = found;
        // Only the key of +0 is 0.
        let corner = |key: i32, axis: usize| {
            let key = if low[axis] <= high[axis] { key } else { 0 };
            coordinate(key)
        };
        let corner_of = |keys: [i32; 3]| std::array::from_fn(|axis| corner(keys[axis], axis));
        Self { low: corner_of(low), high: corner_of(high) }
    }

    /// Lower corner.
    pub const fn low(&self) -> [f32; 3] {
        self.low
    }

    /// Higher corner.
    pub const fn high(&self) -> [f32; 3] {
        self.high
    }
}

/// Keys of the smallest and largest finite coordinates so far.
#[derive(Clone, Copy)]
struct Extremes {
    low: [i32; 3],
    high: [i32; 3],
}

impl Extremes {
    const NONE: Self = Self { low: [i32::MAX; 3], high: [i32::MIN; 3] };

    fn with(mut self, b: &Aabb) -> Self {
        let (keys, class) = KeyBox::classify(b);
        if class == BoxClass::Valid {
            for axis in 0..3 {
                let faces = [keys.min[axis], keys.max[axis]].into_iter();
                for key in faces.filter(|key| FINITE_KEYS.contains(key)) {
                    self.low[axis] = self.low[axis].min(key);
                    self.high[axis] = self.high[axis].max(key);
                }
            }
        }
        self
    }

    fn joined(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_checked() {
        let wrong = |low: f32, high: f32| Bounds::new([0.0, low, 0.0], [1.0, high, 1.0]);
        assert!(wrong(0.0, 0.0).is_ok() && wrong(f32::MIN, f32::MAX).is_ok());
        for (low, high) in [(1.0, 0.0), (f32::NAN, 1.0), (0.0, f32::NAN), (f32::NEG_INFINITY, 0.0)]
        {
            assert_eq!(wrong(low, high).map_err(|e| e.axis), Err(1), "{low} {high}");
        }
    }

    #[test]
    fn bounds_go_around_finite_coordinates_of_valid_boxes() {
        let ground = Aabb::from([-2.0, f32::NEG_INFINITY, -2.0, 2.0, 0.5, 2.0]);
        let invalid = Aabb::from([f32::NAN, 0.0, 0.0, 900.0, 900.0, 900.0]);
        let found = Bounds::around(&[ground, Aabb::EMPTY, invalid, Aabb::from([1.0; 6])]);
        assert_eq!(found.low(), [-2.0, 0.5, -2.0]);
        assert_eq!(found.high(), [2.0, 1.0, 2.0]);
        let nothing = Bounds::around(&[Aabb::EMPTY]);
        assert_eq!((nothing.low(), nothing.high()), ([0.0; 3], [0.0; 3]));
    }
}
