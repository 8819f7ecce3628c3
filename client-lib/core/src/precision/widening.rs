//! The largest gap of two boxes that a mode reports as a pair.
//!
//! On one axis a pair is reported when the face where one box ends, moved outward, reaches the face
//! where the other starts, moved outward too. So the gap of a reported pair is at most the sum of both
//! moves, and each mode defines how far it moves a face at a coordinate. Steps of f32 and of halves
//! grow with the coordinate, and beyond the range of a form there is no limit. So the gap is a
//! function of the two faces, not one number.

use std::fmt;

use super::bounds::Bounds;
use super::exact::widen;
use crate::floats;

/// The gap, in units of the boxes, up to which a pair that does not overlap may be reported.
///
/// Such a pair overlaps or has no larger gap on *every* axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Widening {
    /// No extra pair.
    #[default]
    None,
    /// A cell on each axis. Boxes outside the bounds on one side count as overlapping on that axis,
    /// regardless of their gap.
    Cells {
        /// Size of a cell on each axis, rounded up.
        size: [f64; 3],
        /// The bounds that are cut into cells.
        bounds: Bounds,
    },
    /// A share of the larger coordinate's magnitude, and at least `least` units near zero.
    /// Magnitudes above `beyond` count as infinite.
    Relative {
        /// Share of the magnitude.
        share: f64,
        /// Units, near zero.
        least: f64,
        /// Units.
        beyond: f64,
    },
    /// Boxes in f64 relative to an origin ([`Aabb::outward_from_f64`](crate::aabb::Aabb::outward_from_f64)):
    /// faces are those in f64. Each moves by a step of f32 at its distance from the origin; distances
    /// beyond the largest f32 count as infinite.
    Origin([f64; 3]),
}

impl Widening {
    /// Halves have 11 significant bits and are multiples of 2⁻²⁴; both faces may move by one step.
    pub(super) const HALVES: Self =
        Self::Relative { share: 1.0 / 512.0, least: 1.0 / 8_388_608.0, beyond: 65_504.0 };

    /// The largest gap that two boxes may have and still be reported as a pair, on axis 0, 1 or 2, where
    /// one of them ends at `ends` and the other starts at `starts`. Infinite where there is no limit.
    ///
    /// ```
    /// use pairmask_core::Precision;
    /// let halves = Precision::F16.widening();
    /// assert!(halves.gap_limit(0, 1000.0, 1001.0) < 2.0);
    /// assert!(halves.gap_limit(0, 70_000.0, 1e30) > 9e29, "halves end at 65,504");
    /// ```
    ///
    /// # Panics
    /// When there is no such axis.
    pub fn gap_limit(&self, axis: usize, ends: f64, starts: f64) -> f64 {
        floats::with_default(|| outward(self.gap_between(axis, [ends; 2], [starts; 2])))
    }

    /// As [`gap_limit`](Self::gap_limit), for faces between two places each, the second of which is
    /// farther outward. With the default flags, up to rounding.
    pub(crate) fn gap_between(&self, axis: usize, ends: [f64; 2], starts: [f64; 2]) -> f64 {
        let common = match self {
            Self::Cells { size, .. } => size[axis],
            Self::None | Self::Relative { .. } | Self::Origin(_) => 0.0,
        };
        let face = |[near, far]: [f64; 2]| {
            let step = self.face_step(axis, near).max(self.face_step(axis, far));
            step + self.unreported(axis, near).max(self.unreported(axis, far))
        };
        common + face(ends) + face(starts)
    }

    /// How far the form moves a face at `x` within its range.
    fn face_step(&self, axis: usize, x: f64) -> f64 {
        match self {
            Self::None | Self::Cells { .. } => 0.0,
            Self::Relative { share, least, beyond } => {
                0.5 * (share * x.abs().min(*beyond)).max(*least)
            }
            Self::Origin(origin) => step_of_f32(x - origin[axis]),
        }
    }

    /// Distance of a face at `x` beyond the form's range: the form does not see that part of a gap.
    fn unreported(&self, axis: usize, x: f64) -> f64 {
        let (x, low, high) = match self {
            Self::None => return 0.0,
            Self::Cells { bounds, .. } => {
                (x, widen(bounds.low()[axis]), widen(bounds.high()[axis]))
            }
            Self::Relative { beyond, .. } => (x, -beyond, *beyond),
            Self::Origin(origin) => (x - origin[axis], -LARGEST, LARGEST),
        };
        (low - x).max(x - high).max(0.0)
    }
}

/// The largest f32.
const LARGEST: f64 = f32::MAX as f64;

/// The distance between neighbouring f32 of magnitude up to `x`, or more: 2⁻²³ of it, and 2⁻¹⁴⁹ at
/// least. A millionth of that is added because `x` itself is rounded.
pub(super) fn step_of_f32(x: f64) -> f64 {
    const SHARE: f64 = (1.0 + 1e-6) / (1u64 << 23) as f64;
    const LEAST: f64 = f64::from_bits((1023 - 149) << 52);
    (x.abs() * SHARE).max(LEAST)
}

/// A sum of a few terms, none below 0, moved up by more than its rounding error.
pub(super) fn outward(sum: f64) -> f64 {
    sum * (1.0 + 16.0 * f64::EPSILON)
}

impl fmt::Display for Widening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("no extra pair"),
            Self::Cells { size: [x, y, z], .. } => {
                // The shortest digits of an f32: cells of a small world are far below 0.0001.
                let [x, y, z] = [x, y, z].map(|size| *size as f32);
                write!(f, "gaps below {x} x {y} x {z} units within the bounds")
            }
            Self::Relative { share, least, beyond } => {
                write!(
                    f,
                    "gaps below {share} of the coordinate, or {least}; none seen beyond {beyond}"
                )
            }
            Self::Origin([x, y, z]) => {
                write!(f, "gaps of two steps of f32 at the distance from {x} x {y} x {z}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;
    use crate::aabb::Aabb;
    use crate::precision::Precision;
    use crate::precision::f16;

    #[test]
    fn far_from_zero_steps_of_f32_are_in_the_limit() {
        let origin = Widening::Origin([1e9, 0.0, 0.0]);
        assert!(origin.gap_limit(0, 1e9 + 1.0, 1e9 + 1.0) < 2.5e-7);
        assert!(origin.gap_limit(1, 1e9, 1e9) > 128.0, "that axis' origin is 0");
        assert_eq!(origin.gap_limit(0, f64::INFINITY, f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn what_lies_outside_of_the_range_is_not_distinguished() {
        let bounds = Bounds::new(Vec3::ZERO, Vec3::splat(256.0)).expect("bounds");
        let cells = Precision::Q8(bounds).widening();
        assert!((1.0..1.001).contains(&cells.gap_limit(0, 3.0, 4.0)));
        assert!(cells.gap_limit(1, 300.0, 5000.0) >= 4700.0);
        assert!(cells.gap_limit(2, -800.0, 0.5) >= 800.5);
        assert_eq!(Precision::Exact.widening().gap_limit(0, -9.0, f64::INFINITY), 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// Two faces that halves do not distinguish are no farther apart than the limit, at any place.
        #[test]
        fn halves_keep_to_their_limit(bits in any::<u32>(), by in 0u32..20_000) {
            let ends = f32::from_bits(bits);
            prop_assume!(!ends.is_nan());
            let later = if bits >> 31 == 0 { bits.wrapping_add(by) } else { bits.wrapping_sub(by) };
            let mut starts = f32::from_bits(later);
            if starts.is_nan() || widen(starts) <= widen(ends) {
                starts = f32::MAX;
            }
            let faces = |x: f32| f16::narrow(&Aabb { min: [x; 3], max: [x; 3] });
            let (upper, lower) = (f16::expand(faces(ends).max[0]), f16::expand(faces(starts).min[0]));
            let (ends, starts) = (widen(ends), widen(starts));
            if widen(lower) <= widen(upper) && starts > ends {
                let limit = Widening::HALVES.gap_limit(0, ends, starts);
                prop_assert!(starts - ends <= limit, "{} to {}: {}", ends, starts, limit);
            }
        }
    }
}
