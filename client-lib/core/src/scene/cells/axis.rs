//! Cells of one axis: a coordinate becomes a whole number of quanta, 2^[`CELL_BITS`] of which are a cell.
//!
//! # Why no pair is lost
//!
//! The map to quanta ([`Scale`](super::quanta::Scale)) is monotone. Let boxes a and b overlap, b be at most `reach` quanta
//! long, and c be the cell of b.min. Then a.min ≤ b.max and b.min ≤ a.max, so
//!
//! > q(a.min) − reach ≤ q(b.max) − reach ≤ q(b.min) ≤ q(a.max)
//!
//! and c is one of cell(q(a.min) − reach) ..= cell(q(a.max)). It need not be the cell of b.min itself:
//! each from cell(q(b.max) − reach) to cell(q(b.min)) is as good. So a box that shrinks may stay.
//! Folding cell numbers keeps equal cells equal, and clamping keeps their order.
//!
//! All of it holds only where one function is computed, so with the default floating-point flags.

use std::ops::Range;

use crate::floats;

/// Quanta of a cell, as a power of two.
pub(super) const CELL_BITS: u32 = 11;
/// Longest boxes of a level, and longest questions that are compared by quanta. Their sum is below
/// 2^15, so that 16 bits say which of two coordinates near each other is larger.
pub(super) const LONGEST: i32 = 1 << 13;

/// The cells of an axis of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    /// Where quanta begin.
    pub origin: f32,
    /// Quanta of a unit of length.
    pub per_unit: f32,
    /// Quanta of the longest box, at most [`LONGEST`].
    pub reach: i32,
    /// Cells of the table.
    pub count: u32,
    /// Whether cells of several places share one of the table.
    pub wraps: bool,
}

impl Axis {
    /// One cell for everything.
    pub const WHOLE: Self =
        Self { origin: 0.0, per_unit: 1.0, reach: LONGEST, count: 1, wraps: false };

    /// `count` cells of `edge` from `start` on, for boxes of up to `longest`; what lies outside is in
    /// the first or the last one.
    pub fn clamped(start: f32, edge: f32, longest: f32, count: u32) -> Self {
        debug_assert!(floats::are_default(), "axes are made with the default flags");
        // An edge of 0 or without a finite inverse would make the step 0 · ∞ and lose monotony.
        let edge = if edge.is_finite() { edge.max(1e-30) } else { f32::MAX };
        let per_unit = ((1 << CELL_BITS) as f32 / edge).max(f32::MIN_POSITIVE);
        let origin = if start.is_finite() { start } else { 0.0 };
        // One cell takes boxes of any length that can be compared: a search goes nowhere else.
        let longest = if count == 1 { f32::MAX } else { longest };
        let reach = (longest * per_unit).clamp(1.0, LONGEST as f32) as i32;
        Self { origin, per_unit, reach, count, wraps: false }
    }

    /// The same without end, folded into `count` cells, a power of two.
    pub fn wrapped(start: f32, edge: f32, longest: f32, count: u32) -> Self {
        debug_assert!(count.is_power_of_two());
        Self { wraps: count > 1, ..Self::clamped(start, edge, longest, count) }
    }

    /// The cell of the table that holds a quantum.
    #[inline(always)]
    pub fn cell(&self, quantum: i32) -> u32 {
        let cell = quantum >> CELL_BITS;
        let last = self.count as i32 - 1;
        (if self.wraps { cell & last } else { cell.clamp(0, last) }) as u32
    }

    /// Whether boxes in all of these cells are less than 2^15 quanta from those that look there: not so in
    /// a cell that several places share, or in one that has no end.
    #[inline(always)]
    pub fn are_bounded(&self, cells: &[Range<u32>; 2]) -> bool {
        !self.wraps && cells[0].start > 0 && cells[0].end < self.count
    }

    /// The cells in which boxes may lie that overlap `low..=high`, as two ranges; the second may be
    /// empty.
    #[inline(always)]
    pub fn cells(&self, low: i32, high: i32) -> [Range<u32>; 2] {
        let low = low - self.reach;
        let (first, last) = (self.cell(low), self.cell(high));
        if !self.wraps {
            return [first..last + 1, 0..0];
        }
        if (high >> CELL_BITS) - (low >> CELL_BITS) >= self.count as i32 - 1 {
            return [0..self.count, 0..0];
        }
        if first <= last { [first..last + 1, 0..0] } else { [first..self.count, 0..last + 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::super::quanta::Scale;
    use super::*;
    use crate::aabb::Aabb;
    use proptest::prelude::*;

    /// A coordinate in quanta, by the map that cells use.
    fn quantum(axis: &Axis, x: f32) -> i32 {
        let scale = Scale { origin: [axis.origin; 4], per_unit: [axis.per_unit; 4] };
        let b = Aabb { min: [x; 3], max: [x; 3] };
        let q = scale.quanta(&b);
        assert_eq!(q.min[..3], q.max[..3]);
        q.min[0]
    }

    fn axes() -> Vec<Axis> {
        let mut axes = vec![Axis::WHOLE];
        for growth in [0.25, 1.0, 3.0] {
            for start in [0.0, -1.0e6, 3.0e38, 1e-40, f32::INFINITY] {
                for edge in [0.0, 1e-45, 1e-3, 1.0, 1.0e30, f32::MAX] {
                    let longest = growth * edge;
                    axes.extend([1, 5, 17].map(|n| Axis::clamped(start, edge, longest, n)));
                    axes.extend([4, 16].map(|n| Axis::wrapped(start, edge, longest, n)));
                }
            }
        }
        axes
    }

    proptest! {
        /// What the search relies on, for boxes a and b that overlap on the axis.
        #[test]
        fn a_box_that_overlaps_lies_in_the_cells_that_are_looked_at(
            bits in prop::array::uniform4(any::<u32>()),
            near in any::<bool>(),
        ) {
            let mut x = bits.map(f32::from_bits);
            if near {
                x = bits.map(|b| (b % 4096) as f32 * 0.01 - 7.0);
            }
            prop_assume!(x.iter().all(|x| !x.is_nan()));
            let (a, b) = ([x[0].min(x[1]), x[0].max(x[1])], [x[2].min(x[3]), x[2].max(x[3])]);
            prop_assume!(a[0] <= b[1] && b[0] <= a[1]);
            for axis in axes() {
                let ([a_low, a_high], [low, high]) =
                    (a.map(|x| quantum(&axis, x)), b.map(|x| quantum(&axis, x)));
                prop_assert!(a_low <= high && low <= a_high, "{axis:?}: quanta rise");
                if high - low > axis.reach {
                    continue;
                }
                let looked_at = axis.cells(a_low, a_high);
                for home in [axis.cell(low), axis.cell(high - axis.reach)] {
                    prop_assert!(home < axis.count, "{axis:?}");
                    prop_assert!(looked_at.iter().any(|r| r.contains(&home)), "{axis:?} {a:?} {b:?}");
                }
                let total: u32 = looked_at.iter().map(|r| r.end - r.start).sum();
                prop_assert!(total <= axis.count && looked_at.iter().all(|r| r.end <= axis.count));
            }
        }
    }
}
