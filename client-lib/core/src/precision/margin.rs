//! Margins: boxes inflated so that an answer stays good while nothing moves far.
//!
//! Inflated faces are rounded outward, so that a box whose faces moved by no more than the margin
//! lies within its inflated self. They are computed with the default floating-point flags: a thread
//! that takes subnormals for zero would not see to that.

use super::widening::{Widening, outward, step_of_f32};
use crate::aabb::{Aabb, BoxClass, order_key};
use crate::floats;

/// How far boxes may move before they are sent again, units; finite and not negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Margin(f32);

/// Why a number is no margin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a margin of {given}: give a finite number that is not negative")]
pub struct MarginError {
    /// What was given.
    pub given: f32,
}

impl Margin {
    /// A margin of so many units.
    ///
    /// # Errors
    /// [`MarginError`] where it is negative, infinite or NaN.
    pub fn new(units: f32) -> Result<Self, MarginError> {
        // A comparison of floats would take a subnormal below 0 for 0 on some threads.
        let is_margin = units.is_finite() && order_key(units.to_bits()) >= 0;
        if is_margin { Ok(Self(units)) } else { Err(MarginError { given: units }) }
    }

    /// The number itself.
    pub const fn get(self) -> f32 {
        self.0
    }

    /// A box whose faces lie outward by the margin and up to two steps of f32 more. Empty and
    /// invalid boxes stay as they are.
    ///
    /// The inflated box is the same whatever the floating-point flags of this thread.
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

    #[inline]
    fn inflate_with_default_flags(self, b: &Aabb) -> Aabb {
        debug_assert!(floats::are_default(), "boxes are inflated with the default flags");
        if b.class() != BoxClass::Solid {
            return *b;
        }
        // The rounded difference is within half a step of the exact one: a step is enough.
        Aabb {
            min: b.min.map(|x| (x - self.0).next_down()),
            max: b.max.map(|x| (x + self.0).next_up()),
        }
    }

    /// How far outward a face at `x` comes to lie at most: the margin and two steps of f32 there. Those
    /// outweigh a small margin far from 0: at 10^6 units two steps are a quarter of a unit.
    fn reach(self, x: f64) -> f64 {
        let margin = f64::from(self.0);
        2.0f64.mul_add(step_of_f32(x.abs() + margin), margin)
    }

    /// The largest gap that two boxes may have and still be a pair of the answer that was asked for
    /// with them: on an axis on which one ends at `ends` and the other starts at `starts`, their boxes
    /// being sent in a form that widens them by `form`. It is twice the margin, the steps of f32 that
    /// inflated faces are rounded by, and what the form adds; infinite where a face is.
    ///
    /// While the answer is kept, boxes may move apart, each face by as much again; a box that shrinks
    /// stays in the answer however small it becomes. `MarginedMask::exact_pairs` of a session goes by the boxes of now.
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

        /// A face that moved by the margin at most, in exact arithmetic, is within.
        #[test]
        fn inflated_boxes_reach_as_far_as_the_margin(
            x in -1e6f32..1e6, by in prop_oneof![0.0f32..10.0, 0.0f32..1e-30], share in -1.0f64..=1.0,
        ) {
            let inflated = Margin(by).inflate(&Aabb { min: [x; 3], max: [x; 3] });
            let moved = f64::from(x) + share * f64::from(by);
            // The sum may have been rounded outward; what is truly within is inward of it.
            let (low, high) = (f64::from(inflated.min[0]), f64::from(inflated.max[0]));
            prop_assert!(low <= moved.max(f64::from(x) - f64::from(by)));
            prop_assert!(high >= moved.min(f64::from(x) + f64::from(by)));
            let two_up = inflated.min[0].next_up().next_up();
            prop_assert!(f64::from(two_up) >= f64::from(x) - f64::from(by));
        }
    }
}
