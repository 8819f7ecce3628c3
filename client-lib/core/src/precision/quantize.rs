//! Coordinates → cells of the bounds: the forms q16 and q8.
//!
//! An axis of the bounds is cut into 65,536 or 256 cells of one size. A box becomes the cells that
//! it touches: the number of the cell of its min and the number of the cell of its max. That is the
//! box rounded outward to whole cells, and two boxes overlap in this form when they touch a common
//! cell on every axis. (Rounding the max up to the next border instead would let boxes meet over a
//! gap of two cells.)
//!
//! # Why no pair is lost
//!
//! Min and max go through the same function, cell(x) = ⌊(x − low) · scale⌋, cut off at the first
//! and last cell. It is monotone as computed, not only as written:
//!
//! * x is made an f64, which is exact;
//! * a difference and a product that IEEE 754 rounds correctly are monotone in x, since exact
//!   difference and product by `scale >= 0` are, and rounding is;
//! * it is cut off at both ends: −∞ and every number below the bounds is cell 0, +∞ and every number
//!   above is the last cell. Where the bounds have no width, `scale` is 0 and every x is cell 0,
//!   also ±∞, whose product by 0 is NaN and taken for 0;
//! * the floor is exact.
//!
//! The two functions must also be one and the same for all threads that write a frame. Denormal flags
//! change nothing: `widen` makes an f64 of a subnormal f32 by integers, and differences and products
//! of such f64 are 0 or far from f64's subnormals. The rounding mode does change differences and
//! products, so cells are computed with the default flags ([`crate::floats`]).

use super::bounds::Bounds;
use super::exact::{GROUP_WORDS, Group, is_valid, widen};
use super::narrow::{BoxQ8, BoxQ16, NarrowBox};
use crate::aabb::Aabb;
use crate::floats;

/// Cells of an axis in the form q16.
const Q16_CELLS: f64 = 65_536.0;
/// Cells of an axis in the form q8.
const Q8_CELLS: f64 = 256.0;

/// Room for the rounding of a cell number: one part in 2³⁰, thousands of times what two roundings
/// of f64 come to at the last of 65,536 cells.
const ROUNDING: f64 = 1.0 + 1.0 / (1u64 << 30) as f64;

/// 2⁵²: f64 of this size are whole numbers, and the last bits of theirs are the number's.
const WHOLE: f64 = 4_503_599_627_370_496.0;

/// The whole part of a position, cut off at 0 and at the last cell.
///
/// As `position as u16` is, but without the conversion, which compilers do not vectorise.
#[inline(always)]
fn cell(position: f64, last: f64) -> i32 {
    // In this order NaN becomes 0.
    let position = if position > 0.0 { position } else { 0.0 };
    let position = if position < last { position } else { last };
    // The sum is a whole number next to the position, below or above.
    let sum = position + WHOLE;
    let is_above = sum - WHOLE > position;
    sum.to_bits() as i32 - i32::from(is_above)
}

/// A quantizer's numbers for each coordinate of a group.
pub(super) struct Lanes {
    low: [f64; GROUP_WORDS],
    scale: [f64; GROUP_WORDS],
    last: f64,
}

impl Lanes {
    pub(super) fn new(quantizer: &Quantizer) -> Self {
        Self {
            low: std::array::from_fn(|at| quantizer.low[at % 3]),
            scale: std::array::from_fn(|at| quantizer.scale[at % 3]),
            last: quantizer.last,
        }
    }

    /// The cells of a group of valid boxes.
    #[inline(always)]
    pub(super) fn cells(&self, group: &Group) -> [i32; GROUP_WORDS] {
        debug_assert!(floats::are_default(), "cells are computed with the default flags");
        let mut cells = [0; GROUP_WORDS];
        for at in 0..GROUP_WORDS {
            cells[at] = cell((widen(group[at]) - self.low[at]) * self.scale[at], self.last);
        }
        cells
    }
}

/// Turns boxes into cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantizer {
    low: [f64; 3],
    /// Cells a unit; 0 where the bounds have no width.
    scale: [f64; 3],
    /// Number of the last cell.
    last: f64,
}

impl Quantizer {
    /// Cuts each axis of the bounds into `cells` cells.
    fn new(bounds: &Bounds, cells: f64) -> Self {
        floats::with_default(|| Self::with_default_flags(bounds, cells))
    }

    fn with_default_flags(bounds: &Bounds, cells: f64) -> Self {
        let low = bounds.low().map(widen);
        let high = bounds.high().map(widen);
        let scale = std::array::from_fn(|axis| {
            let width = high[axis] - low[axis];
            if width > 0.0 { cells / width } else { 0.0 }
        });
        Self { low, scale, last: cells - 1.0 }
    }

    /// For the form q16.
    pub fn q16_of(bounds: &Bounds) -> Self {
        Self::new(bounds, Q16_CELLS)
    }

    /// For the form q8.
    pub fn q8_of(bounds: &Bounds) -> Self {
        Self::new(bounds, Q8_CELLS)
    }

    /// Size of a cell on each axis, units, rounded up: two boxes within the bounds that are
    /// reported as a pair have no gap as wide as that.
    pub fn cell_size(&self) -> [f64; 3] {
        floats::with_default(|| {
            self.scale.map(|scale| if scale > 0.0 { ROUNDING / scale } else { 0.0 })
        })
    }

    #[inline(always)]
    fn cell(&self, axis: usize, x: f64) -> i32 {
        debug_assert!(floats::are_default(), "cells are computed with the default flags");
        cell((x - self.low[axis]) * self.scale[axis], self.last)
    }

    /// The cells of a box's min and max, on a thread with the default flags; `None` where it is not valid.
    #[inline(always)]
    pub(super) fn cells(&self, b: &Aabb) -> Option<[[i32; 3]; 2]> {
        let (min, max) = (b.min.map(widen), b.max.map(widen));
        let cells = |x: [f64; 3]| std::array::from_fn(|axis| self.cell(axis, x[axis]));
        is_valid(&min, &max).then(|| [cells(min), cells(max)])
    }

    /// A box in 16-bit cells: the same ones regardless of the flags of this thread.
    #[inline]
    pub fn q16(&self, b: &Aabb) -> BoxQ16 {
        floats::with_default(|| BoxQ16::narrow(b, self))
    }

    /// A box in 8-bit cells: the same ones regardless of the flags of this thread.
    #[inline]
    pub fn q8(&self, b: &Aabb) -> BoxQ8 {
        floats::with_default(|| BoxQ8::narrow(b, self))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Any f32 that is a number, with extremes more often than by chance.
    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![
            4 => any::<u32>().prop_map(f32::from_bits).prop_filter("a number", |x| !x.is_nan()),
            2 => -1000.0f32..1000.0,
            1 => prop::sample::select(vec![
                0.0, -0.0, 1e-45, -1e-45, f32::MIN_POSITIVE, -f32::MIN_POSITIVE, f32::MIN, f32::MAX,
                f32::INFINITY, f32::NEG_INFINITY, 1.0, -1.0,
            ]),
        ]
    }

    fn bounds() -> impl Strategy<Value = Bounds> {
        let finite = || number().prop_map(|x| x.clamp(f32::MIN, f32::MAX));
        let corner = || prop::array::uniform3(finite());
        (corner(), corner(), any::<bool>()).prop_filter_map("bounds", |(a, b, flat)| {
            let high = if flat { a } else { std::array::from_fn(|x| a[x].max(b[x])) };
            let low: [f32; 3] = std::array::from_fn(|x| a[x].min(b[x]).min(high[x]));
            Bounds::new(low, high).ok()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// The whole proof in one property: cells are in the order of the numbers.
        #[test]
        fn cells_are_monotone(bounds in bounds(), x in number(), y in number(), near in any::<bool>()) {
            let y = if near { x.next_up() } else { y };
            prop_assume!(!y.is_nan());
            let (x, y) = if widen(x) <= widen(y) { (x, y) } else { (y, x) };
            for cells in [Q16_CELLS, Q8_CELLS] {
                let quantizer = Quantizer::new(&bounds, cells);
                for axis in 0..3 {
                    let at = |x| quantizer.cell(axis, widen(x));
                    prop_assert!(at(x) <= at(y), "{x:e} {y:e} {bounds:?}");
                    prop_assert!(0 <= at(x) && f64::from(at(y)) < cells);
                }
            }
        }

        #[test]
        fn a_common_cell_is_no_wider_than_said(bounds in bounds(), x in number(), y in number()) {
            for cells in [Q16_CELLS, Q8_CELLS] {
                let quantizer = Quantizer::new(&bounds, cells);
                for axis in 0..3 {
                    let (low, high) = (bounds.low()[axis], bounds.high()[axis]);
                    let inside = |x: f32| x.clamp(low, high);
                    let (x, y) = (widen(inside(x)), widen(inside(y)));
                    if quantizer.cell(axis, x) == quantizer.cell(axis, y) {
                        prop_assert!((x - y).abs() <= quantizer.cell_size()[axis], "{x:e} {y:e}");
                    }
                }
            }
        }

    }

    #[test]
    fn cells_are_floors() {
        let floor = |x: f64, last: f64| x.floor().clamp(0.0, last) as i32;
        for whole in 0..=65_536 {
            let whole = f64::from(whole);
            for x in [whole, whole.next_up(), whole.next_down(), whole + 0.5] {
                for last in [65_535.0, 255.0] {
                    assert_eq!(cell(x, last), floor(x, last), "{x}");
                }
            }
        }
        for (x, expected) in [
            (f64::NAN, 0),
            (f64::INFINITY, 255),
            (f64::NEG_INFINITY, 0),
            (-0.0, 0),
            (-1e300, 0),
            (1e300, 255),
        ] {
            assert_eq!(cell(x, 255.0), expected, "{x}");
        }
    }

    #[test]
    fn classes_survive() {
        let bounds = Bounds::new([0.0; 3], [1.0; 3]).expect("bounds");
        let quantizer = Quantizer::new(&bounds, Q16_CELLS);
        let barely = Aabb::from([0.5f32.next_up(), 0.0, 0.0, 0.5, 1.0, 1.0]);
        assert_eq!(quantizer.q16(&barely), BoxQ16::EMPTY, "cells alone would make it valid");
        let subnormal = Aabb::from([3e-45, 0.0, 0.0, 1e-45, 1.0, 1.0]);
        assert_eq!(quantizer.q16(&subnormal), BoxQ16::EMPTY);
        let mut invalid = Aabb::EMPTY;
        invalid.max[2] = f32::NAN;
        assert_eq!(quantizer.q16(&invalid), BoxQ16::INVALID);
        assert_eq!(quantizer.q8(&invalid), BoxQ8::INVALID);
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        assert_eq!(quantizer.q16(&all), BoxQ16 { min: [0; 3], max: [u16::MAX; 3] });
        assert_eq!(quantizer.q8(&all), BoxQ8 { min: [0; 3], max: [u8::MAX; 3] });
    }

    #[test]
    fn cells_are_where_the_formula_has_them() {
        let bounds = Bounds::new([-128.0; 3], [128.0; 3]).expect("bounds");
        let quantizer = Quantizer::new(&bounds, Q8_CELLS);
        let b = Aabb::from([-128.5, -128.0, 0.0f32.next_down(), 0.0, 127.0f32.next_down(), 128.0]);
        assert_eq!(quantizer.q8(&b), BoxQ8 { min: [0, 0, 128], max: [128, 254, 255] });
        // −1e-45 + 128 rounds to 128: one cell later than in exact arithmetic, for min and max.
        assert_eq!(quantizer.cell_size().map(f64::round), [1.0; 3]);
    }
}
