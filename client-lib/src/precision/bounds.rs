//! The part of the world that quantised boxes tell apart.

use rayon::prelude::*;

use crate::aabb::{Aabb, BoxClass};

/// Boxes that one task of [`Bounds::around`] looks at: fewer take less time than a task costs.
const TASK_BOXES: usize = 16_384;

/// Finite world bounds, `low <= high` on every axis.
///
/// Whatever lies outside is taken to lie in the outermost cells: no pair is lost, but two boxes
/// outside on one side cannot be told apart on that axis, however far they are from each other.
/// On an axis where `low == high` all boxes overlap.
///
/// ```
/// use pairmask::precision::Bounds;
/// let world = Bounds::new([-500.0; 3], [500.0; 3])?;
/// assert!(Bounds::new([1.0; 3], [0.0; 3]).is_err());
/// # Ok::<(), pairmask::precision::BoundsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

/// Why two corners are no bounds.
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
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return Err(BoundsError { axis, low, high });
            }
        }
        Ok(Self { low, high })
    }

    /// The tightest bounds around the finite coordinates of the solid boxes; a point at the origin
    /// where there are none. Reads every box, large scenes on the rayon pool.
    pub fn around(boxes: &[Aabb]) -> Self {
        let of = |boxes: &[Aabb]| boxes.iter().fold(Extremes::NONE, Extremes::with);
        let found =
            boxes.par_chunks(TASK_BOXES).map(of).reduce(|| Extremes::NONE, |a, b| a.joined(&b));
        let Extremes { low, high } = found;
        let axis = |axis: usize| {
            if low[axis] <= high[axis] { (low[axis], high[axis]) } else { (0.0, 0.0) }
        };
        Self { low: std::array::from_fn(|a| axis(a).0), high: std::array::from_fn(|a| axis(a).1) }
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

/// Smallest and largest finite coordinates so far.
#[derive(Clone, Copy)]
struct Extremes {
    low: [f32; 3],
    high: [f32; 3],
}

impl Extremes {
    const NONE: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    fn with(mut self, b: &Aabb) -> Self {
        if b.class() == BoxClass::Solid {
            for axis in 0..3 {
                for x in [b.min[axis], b.max[axis]].into_iter().filter(|x| x.is_finite()) {
                    self.low[axis] = self.low[axis].min(x);
                    self.high[axis] = self.high[axis].max(x);
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
    fn bounds_go_around_finite_coordinates_of_solid_boxes() {
        let ground = Aabb::from([-2.0, f32::NEG_INFINITY, -2.0, 2.0, 0.5, 2.0]);
        let invalid = Aabb::from([f32::NAN, 0.0, 0.0, 900.0, 900.0, 900.0]);
        let found = Bounds::around(&[ground, Aabb::EMPTY, invalid, Aabb::from([1.0; 6])]);
        assert_eq!(found.low(), [-2.0, 0.5, -2.0]);
        assert_eq!(found.high(), [2.0, 1.0, 2.0]);
        let nothing = Bounds::around(&[Aabb::EMPTY]);
        assert_eq!((nothing.low(), nothing.high()), ([0.0; 3], [0.0; 3]));
    }
}
