//! Margins: boxes are inflated so that an answer stays valid while no box moves far.
//!
//! Inflated faces are rounded outward, so that a box whose faces moved by no more than the margin
//! lies within its inflated self. They are computed with the default floating-point flags: a thread
//! that treats subnormals as zero would round some of them inward.

use super::widening::{Widening, outward, step_of_f32};
use crate::aabb::{Aabb, BoxClass, order_key};
use crate::floats;

/// How far boxes may move before they are sent again, units; finite and not negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Margin(f32);

/// Why a number is refused as a margin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a margin of {given}: give a finite number that is not negative")]
pub struct MarginError {
    /// The number.
    pub given: f32,
}

impl Margin {
    /// A margin of `units` units.
    ///
    /// # Errors
    /// [`MarginError`] where it is negative, infinite or NaN.
    pub fn new(units: f32) -> Result<Self, MarginError> {
        // A comparison of floats would treat a subnormal below 0 as 0 on some threads.
        let is_margin = units.is_finite() && order_key(units.to_bits()) >= 0;
        if is_margin { Ok(Self(units)) } else { Err(MarginError { given: units }) }
    }

    /// The number itself.
    pub const fn get(self) -> f32 {
        self.0
    }

    /// Whether it is 0. No comparison of floats, which would take a subnormal for 0 on some threads.
    #[inline]
    pub(crate) const fn is_zero(self) -> bool {
        order_key(self.0.to_bits()) == 0
    }

    /// So many times the margin, or the largest finite one; with the default flags.
    #[inline]
    pub(crate) fn times(self, factor: f32) -> Self {
        debug_assert!(floats::are_default(), "margins are computed with the default flags");
        Self((self.0 * factor).min(f32::MAX))
    }

    /// A box whose faces lie outward by the margin and up to two steps of f32 more. Empty and
    /// invalid boxes stay as they are.
    ///
    /// The inflated box is the same regardless of the floating-point flags of this thread.
    pub fn inflate(self, b: &Aabb) -> Aabb {
        floats::with_default(|| self.inflate_with_default_flags(b))
    }

    /// Boxes inflated, as many as both slices hold; with the default flags.
    pub fn inflate_all(self, boxes: &[Aabb], out: &mut [Aabb]) {
        floats::with_default(|| {
            for (b, out) in boxes.iter().zip(out) {
                *out = self.inflate_with_default_flags(b);
            }
        });
    }

    /// As [`inflate`](Self::inflate), on a thread that has the default flags.
    #[inline]
    pub(crate) fn inflate_with_default_flags(self, b: &Aabb) -> Aabb {
        debug_assert!(floats::are_default(), "boxes are inflated with the default flags");
        if b.class() != BoxClass::Valid {
            return *b;
        }
        // The rounded difference is within half a step of the exact one: a step is enough.
        Aabb {
            min: b.min.map(|x| (x - self.0).next_down()),
            max: b.max.map(|x| (x + self.0).next_up()),
        }
    }

    /// The greatest distance by which a face at `x` is moved outward: the margin and two steps of f32
    /// there. Far from 0 the steps are larger than a small margin: at 10^6 units two steps are up to
    /// a quarter of a unit.
    fn reach(self, x: f64) -> f64 {
        let margin = f64::from(self.0);
        2.0f64.mul_add(step_of_f32(x.abs() + margin), margin)
    }

    /// The largest gap of two boxes that are a pair of the answer to them, on an axis on which one
    /// ends at `ends` and the other starts at `starts`; `form` is the widening of the form in which
    /// they are sent. It is the sum of twice the margin, the steps of f32 by which inflated faces are
    /// rounded, and the widening of the form; infinite where a face is.
    ///
    /// While the answer is kept, boxes may move apart, each face by as much again. A box that shrinks stays in the
    /// answer however small it becomes.
    ///
    /// ```
    /// use pairmask_core::precision::{Margin, Widening};
    /// let margin = Margin::new(0.001)?;
    /// let gap_at = |x| margin.gap_limit(&Widening::None, 0, x, x);
    /// assert!(gap_at(1.0) < 0.00201);
    /// assert!(gap_at(1e6) > 0.25, "f32 has steps of a sixteenth there");
    /// # Ok::<(), pairmask_core::precision::MarginError>(())
    /// ```
    ///
    /// # Panics
    /// When there is no such axis.
    pub fn gap_limit(self, form: &Widening, axis: usize, ends: f64, starts: f64) -> f64 {
        floats::with_default(|| {
            if ends.is_infinite() || starts.is_infinite() {
                return f64::INFINITY;
            }
            let (end_reach, start_reach) = (self.reach(ends), self.reach(starts));
            let form_gap =
                form.gap_between(axis, [ends, ends + end_reach], [starts, starts - start_reach]);
            outward(end_reach + start_reach + form_gap)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn margins_are_checked() {
        assert!(Margin::new(0.0).is_ok() && Margin::new(f32::MAX).is_ok());
        for wrong in [-1.0, f32::NAN, f32::INFINITY, -1e-45] {
            assert!(Margin::new(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// A face that moved by at most the margin, in exact arithmetic, lies within the inflated
        /// box.
        #[test]
        fn inflated_boxes_reach_as_far_as_the_margin(
            x in -1e6f32..1e6, by in prop_oneof![0.0f32..10.0, 0.0f32..1e-30], share in -1.0f64..=1.0,
        ) {
            let inflated = Margin(by).inflate(&Aabb { min: [x; 3], max: [x; 3] });
            let moved = f64::from(x) + share * f64::from(by);
            // The sum may have been rounded outward; a face that is truly within lies inward of it.
            let (low, high) = (f64::from(inflated.min[0]), f64::from(inflated.max[0]));
            prop_assert!(low <= moved.max(f64::from(x) - f64::from(by)));
            prop_assert!(high >= moved.min(f64::from(x) + f64::from(by)));
            let two_up = inflated.min[0].next_up().next_up();
            prop_assert!(f64::from(two_up) >= f64::from(x) - f64::from(by));
        }
    }
}
