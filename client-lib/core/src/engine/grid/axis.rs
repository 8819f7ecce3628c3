//! From a coordinate to a cell number, on one axis.
//!
//! # Why no pair is lost to rounding
//!
//! All that the grid relies on is that the cell function is **monotone**: a ≤ b implies
//! cell(a) ≤ cell(b), in the f32 arithmetic that computes it. It is a chain of monotone steps:
//! subtraction of a constant and multiplication with a positive constant (IEEE rounding is
//! monotone), clamping between constants, and addition of [`ROUND`], which rounds to an integer.
//! That holds far from the origin, for subnormals and for infinities.
//!
//! And cell must be **one** function. The cell of a coordinate is computed by the thread that gives a
//! box its home, and again by the thread that looks around a row. Two threads that round differently,
//! or one of which flushes subnormals, have two functions: each is monotone, and a pair is lost between
//! them. So all of this is computed with the default floating-point flags ([`crate::floats`]): layouts
//! within one call of `with_default`, homes and rows within the parts of `in_parts`. Debug builds
//! assert it.
//!
//! Let boxes a and b overlap: a.min ≤ b.max and b.min ≤ a.max. Then cell(a.min) ≤ cell(b.max) and
//! cell(b.min) ≤ cell(a.max). A box is in a level only if there cell(max) − cell(min) ≤ 1, a test of
//! computed integers. So if b is in the level, cell(b.min) ≥ cell(b.max) − 1 ≥ cell(a.min) − 1:
//!
//! > cell(a.min) − 1 ≤ cell(b.min) ≤ cell(a.max)
//!
//! for any a that overlaps b. How large a cell is in space, and how much rounding moved its border,
//! do not enter. A level may take only boxes whose min lies in a range of cells, since what lies far
//! away would crowd those that it is folded into. Then a box overlaps none of the level where its max
//! lies below that range, or its min more than a cell above. Folding cell numbers (see [`Axis::wrapped`]) keeps equal cells equal.

use crate::floats;

/// 1.5 · 2^23: adding it rounds a number of magnitude below 2^22 to an integer, which then stands
/// in the low bits of the sum. One add instead of a floor and a conversion, on every machine alike.
const ROUND: f32 = 12_582_912.0;

/// Largest magnitude of a cell number. Coordinates beyond share the outermost cell, which folded levels leave to others.
pub(crate) const CELL_LIMIT: f32 = 2_097_152.0;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    origin: f32,
    cells_per_unit: f32,
    low: f32,
    high: f32,
    fold: i32,
    /// Cell numbers between which the min of a box of a level lies.
    beyond: [i32; 2],
    /// Cells that the axis is folded into.
    pub cell_count: u32,
    /// Whether cells may coincide that are far apart, so that the last one has the first one as
    /// its neighbour.
    pub wraps: bool,
}

impl Axis {
    /// One cell for everything.
    pub const WHOLE: Self = Self {
        origin: 0.0,
        cells_per_unit: 1.0,
        low: 0.0,
        high: 0.0,
        fold: -1,
        beyond: [i32::MIN, i32::MAX],
        cell_count: 1,
        wraps: false,
    };

    /// `cell_count` cells of edge `edge` from `start` on; what lies outside is in the first or
    /// the last cell.
    pub fn clamped(start: f32, edge: f32, cell_count: u32) -> Self {
        Self { high: cell_count as f32 - 1.0, cell_count, ..Self::with_edge(start, edge) }
    }

    /// Cells of edge `edge` without end, folded into `cell_count` of them, a power of two: cells
    /// that are a multiple of it apart coincide. Clusters far apart then share a table of
    /// moderate size, at the price of tests that find nothing.
    pub fn wrapped(start: f32, edge: f32, cell_count: u32) -> Self {
        debug_assert!(cell_count.is_power_of_two());
        Self {
            low: -CELL_LIMIT,
            high: CELL_LIMIT,
            fold: cell_count as i32 - 1,
            // What lies beyond is of another level: the outermost cells would have all of it.
            beyond: [-(CELL_LIMIT as i32), CELL_LIMIT as i32],
            cell_count,
            wraps: cell_count > 1,
            ..Self::with_edge(start, edge)
        }
    }

    /// One cell for all whose min is about in `near`, however long it is.
    pub fn whole_of([low, high]: [f32; 2]) -> Self {
        Self {
            low: -1.0,
            high: 1.0,
            fold: 0,
            beyond: [-1, 1],
            ..Self::with_edge(low, (high - low).max(f32::MIN_POSITIVE))
        }
    }

    /// The same cells for boxes whose min is about in `near`: others are not of the level.
    pub fn only(self, [low, high]: [f32; 2]) -> Self {
        let [least, most] = self.beyond;
        let beyond = [(self.cell(low) - 1).max(least), (self.cell(high) + 1).min(most)];
        Self { beyond, ..self }
    }

    fn with_edge(start: f32, edge: f32) -> Self {
        debug_assert!(floats::are_default(), "axes are made with the default flags");
        // An edge of 0 or without a finite inverse would make the step 0 · ∞ and lose monotony.
        let edge = if edge.is_finite() { edge.max(f32::MIN_POSITIVE) } else { f32::MAX };
        let start = if start.is_finite() { start } else { 0.0 };
        let cells_per_unit = (1.0 / edge).max(f32::MIN_POSITIVE);
        // Rounding to the nearest puts borders at half cells; shifted, they are at `start`.
        let origin = start + 0.5 * edge;
        let origin = if origin.is_finite() { origin } else { start };
        Self { origin, cells_per_unit, ..Self::WHOLE }
    }

    /// Edge of a cell, about.
    pub fn edge(&self) -> f32 {
        1.0 / self.cells_per_unit
    }

    /// Unfolded cell number. A NaN, which no valid box has, gets some cell.
    #[inline(always)]
    pub fn cell(&self, x: f32) -> i32 {
        debug_assert!(floats::are_default(), "cells are computed with the default flags");
        let cells = (x - self.origin) * self.cells_per_unit;
        let clamped = cells.max(self.low).min(self.high);
        (clamped + ROUND).to_bits() as i32 - ROUND.to_bits() as i32
    }

    /// Whether a box from one cell number to another may be of a level: it spans two cells at most, and its min is not
    /// beyond.
    #[inline(always)]
    pub fn takes(&self, low: i32, high: i32) -> bool {
        let is_within = (low > self.beyond[0]) as u8 & (low < self.beyond[1]) as u8;
        (high - low <= 1) as u8 & is_within != 0
    }

    /// Whether a box with these cell numbers overlaps no box of a level, since mins there are not beyond, and
    /// maxes at most a cell further.
    #[inline(always)]
    pub fn is_beyond(&self, [low, high]: [i32; 2]) -> bool {
        high <= self.beyond[0] || low > self.beyond[1]
    }

    /// The cell of the table that a cell number is folded into.
    #[inline(always)]
    pub fn fold(&self, cell: i32) -> u32 {
        (cell & self.fold) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axes() -> Vec<Axis> {
        let mut axes = vec![Axis::WHOLE];
        for start in [0.0, -1.0e6, 3.0e38, f32::MIN, f32::INFINITY, 1e-40] {
            for edge in [0.0, 1e-45, 1e-3, 1.0, 1.0e30, f32::MAX, f32::INFINITY] {
                axes.push(Axis::clamped(start, edge, 17));
                axes.push(Axis::wrapped(start, edge, 16));
                axes.push(Axis::wrapped(start, edge, 16).only([-1.0, 2.0]));
                axes.push(Axis::whole_of([start, start + edge]));
            }
        }
        axes
    }

    fn check(axis: &Axis, a: f32, b: f32) {
        let (low, high) = (axis.cell(a.min(b)), axis.cell(a.max(b)));
        assert!(low <= high, "{axis:?}: {a} and {b} are in cells {low} and {high}");
        assert!(axis.fold(low) < axis.cell_count && axis.fold(high) < axis.cell_count);
    }

    #[test]
    fn cells_rise_with_coordinates_at_every_border() {
        for axis in axes() {
            for x in [f32::NEG_INFINITY, f32::MIN, -1.0, -1e-45, 0.0, 1e-45, 1.0, f32::MAX] {
                check(&axis, x, x.next_up());
                check(&axis, x, f32::INFINITY);
            }
            check(&axis, f32::NAN, f32::NAN);
        }
        let axis = Axis::clamped(-7.3, 0.1, 1000);
        for cell in 0..1000 {
            let border = (cell as f32).mul_add(0.1, -7.3);
            let around = (0..50).scan(border - 1e-5, |x, _| {
                *x = x.next_up();
                Some(*x)
            });
            let cells: Vec<_> = around.map(|x| axis.cell(x)).collect();
            assert!(cells.is_sorted(), "{border}: {cells:?}");
        }
    }

    #[test]
    fn no_box_of_a_level_overlaps_what_is_beyond() {
        let ends = [f32::NEG_INFINITY, f32::MIN, -1e6, -1.0, -0.1, 0.0, 0.7, 1.0, 2.5, 40.0, 1e9];
        let boxes: Vec<[f32; 2]> = ends
            .iter()
            .flat_map(|low| ends.map(|high| [*low, high]))
            .chain(ends.map(|low| [low, f32::INFINITY]))
            .filter(|[low, high]| low <= high)
            .collect();
        let numbers = |axis: &Axis, b: &[f32; 2]| b.map(|x| axis.cell(x));
        let mut skipped = 0;
        for axis in axes() {
            for of_level in &boxes {
                let [low, high] = numbers(&axis, of_level);
                if !axis.takes(low, high) {
                    continue;
                }
                for b in &boxes {
                    let is_beyond = axis.is_beyond(numbers(&axis, b));
                    skipped += u32::from(is_beyond);
                    let overlaps = b[0] <= of_level[1] && of_level[0] <= b[1];
                    assert!(!(is_beyond && overlaps), "{axis:?}: {b:?} {of_level:?}");
                }
            }
        }
        assert!(skipped > 100, "{skipped} cases");
    }

    #[test]
    fn plain_coordinates_are_in_the_cell_one_expects() {
        let axis = Axis::clamped(10.0, 2.0, 8);
        for (x, cell) in [(9.0, 0), (10.1, 0), (11.9, 0), (12.1, 1), (25.9, 7), (99.0, 7)] {
            assert_eq!(axis.cell(x), cell, "{x}");
        }
        let axis = Axis::wrapped(10.0, 2.0, 4);
        for (x, cell) in [(9.0, 3), (10.1, 0), (17.9, 3), (18.1, 0), (25.9, 3)] {
            assert_eq!(axis.fold(axis.cell(x)), cell, "{x}");
        }
    }

    proptest! {
        #[test]
        fn cells_rise_with_any_two_coordinates(a in any::<u32>(), b in any::<u32>()) {
            let (a, b) = (f32::from_bits(a), f32::from_bits(b));
            if !a.is_nan() && !b.is_nan() {
                for axis in axes() {
                    check(&axis, a, b);
                }
            }
        }
    }
}
