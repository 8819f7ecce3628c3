//! Cells of one axis: fine ones, of which a power of two make a cell of the table.
//!
//! The proof of the grid's axis holds for fine cells: a box is in a level only if its max lies in
//! the fine cell of its min or the next one, so a box `b` of the level that overlaps `a` has its min in
//! one of `cell(a.min) − 1 ..= cell(a.max)`. Shifting cell numbers and folding them keeps equal cells
//! equal. Large cells in few lines cost less than small ones in many: a line is a miss of the caches.

use std::ops::Range;

use crate::engine::grid;

/// The cells of an axis of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    fine: grid::Axis,
    shift: u32,
    /// Cells of the table.
    pub count: u32,
}

impl Axis {
    /// One cell for everything.
    pub const WHOLE: Self = Self { fine: grid::Axis::WHOLE, shift: 0, count: 1 };

    /// Cells of 2^`shift` fine cells of `edge`, from `start` on, `count` of them; what lies outside is
    /// in the first or the last one.
    pub fn clamped(start: f32, edge: f32, shift: u32, count: u32) -> Self {
        Self { fine: grid::Axis::clamped(start, edge, count << shift), shift, count }
    }

    /// The same without end, folded into `count` cells, a power of two of at least four.
    pub fn wrapped(start: f32, edge: f32, shift: u32, count: u32) -> Self {
        Self { fine: grid::Axis::wrapped(start, edge, count << shift), shift, count }
    }

    /// The fine cell of a coordinate.
    #[inline(always)]
    pub fn fine(&self, x: f32) -> i32 {
        self.fine.cell(x)
    }

    /// The cell of the table that holds a fine cell.
    #[inline(always)]
    pub fn cell(&self, fine: i32) -> u32 {
        let cell = fine >> self.shift;
        if self.fine.wraps { cell as u32 & (self.count - 1) } else { cell as u32 }
    }

    /// The cells that hold the fine cells `low..=high`, as two ranges; the second may be empty.
    #[inline(always)]
    pub fn cells(&self, low: i32, high: i32) -> [Range<u32>; 2] {
        let (low, high) = (low >> self.shift, high >> self.shift);
        if !self.fine.wraps {
            return [low.max(0) as u32..high as u32 + 1, 0..0];
        }
        if high - low + 1 >= self.count as i32 {
            return [0..self.count, 0..0];
        }
        let (first, last) = (low as u32 & (self.count - 1), high as u32 & (self.count - 1));
        if first <= last { [first..last + 1, 0..0] } else { [first..self.count, 0..last + 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axes() -> Vec<Axis> {
        let mut axes = vec![Axis::WHOLE];
        for shift in 0..4 {
            for start in [0.0, -1.0e6, 3.0e38, 1e-40] {
                for edge in [1e-45, 1e-3, 1.0, 1.0e30, f32::MAX] {
                    axes.extend([1, 5, 17].map(|n| Axis::clamped(start, edge, shift, n)));
                    axes.extend([4, 16].map(|n| Axis::wrapped(start, edge, shift, n)));
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
                let [low, high] = b.map(|x| axis.fine(x));
                if high - low > 1 {
                    continue;
                }
                let home = axis.cell(low);
                prop_assert!(home < axis.count, "{axis:?}");
                let looked_at = axis.cells(axis.fine(a[0]) - 1, axis.fine(a[1]));
                prop_assert!(looked_at.iter().any(|r| r.contains(&home)), "{axis:?} {a:?} {b:?}");
                let total: u32 = looked_at.iter().map(|r| r.end - r.start).sum();
                prop_assert!(total <= axis.count && looked_at.iter().all(|r| r.end <= axis.count));
            }
        }
    }
}
