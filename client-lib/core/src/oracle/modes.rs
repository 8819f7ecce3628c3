//! Precision modes by their definitions: the pairs that each mode must and may report, found
//! naively.
//!
//! This module uses none of the library's conversions: cells are f64 arithmetic with `floor`, halves are
//! looked up in a table of all of them, margins and origins are f64 sums. The arithmetic runs with the
//! default floating-point flags, because callers may have any.

use std::sync::LazyLock;

use super::{Corners, Faces, Pair, Truth, exact, faces, pairs_of, truth_of_faces};
use crate::aabb::Aabb;
use crate::floats;
use crate::precision::{Bounds, Precision};

/// The answer of a mode: the pairs of the rounded boxes, and the census of the given ones.
pub fn truth(boxes: &[Aabb], precision: &Precision) -> Truth {
    let round = |x: f32, axis: usize, up: bool| match precision {
        Precision::Exact => exact(x),
        Precision::Q16(bounds) => cell(x, axis, bounds, 65_536.0),
        Precision::Q8(bounds) => cell(x, axis, bounds, 256.0),
        Precision::F16 => half(x, up),
    };
    truth_by(boxes, round)
}

/// As [`truth`], by any rounding: `round(coordinate, axis, is_max)`.
///
/// # Panics
/// With 2^32 boxes or more.
pub fn truth_by(boxes: &[Aabb], round: impl Fn(f32, usize, bool) -> f64) -> Truth {
    let given: Vec<Faces> = boxes.iter().map(faces).collect();
    // Every given coordinate is an f32: the conversion back is exact.
    let pairs = rounded_pairs(&given, |x, axis, up| round(x as f32, axis, up));
    Truth { pairs, census: super::census(&given) }
}

/// The pairs of boxes whose faces were rounded. A box that is not valid before has no pair after.
fn rounded_pairs(boxes: &[Faces], round: impl Fn(f64, usize, bool) -> f64) -> Vec<Pair> {
    floats::with_default(|| pairs_of(&rounded_corners(boxes, round)))
}

fn rounded_corners(boxes: &[Faces], round: impl Fn(f64, usize, bool) -> f64) -> Vec<Corners> {
    let rounded = |b: &Faces| {
        let side = |up: bool| std::array::from_fn(|axis| round(b[usize::from(up)][axis], axis, up));
        let valid = Corners::of_faces(b).valid.is_some();
        Corners { valid: valid.then(|| [side(false), side(true)]) }
    };
    boxes.iter().map(rounded).collect()
}

/// The pairs that must be in an answer, with the census, and those that may be. Both are sorted,
/// and `may` contains `must`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Allowed {
    /// The least answer.
    pub must: Truth,
    /// The pairs of the greatest answer.
    pub may: Vec<Pair>,
}

/// The allowed answers for boxes in a narrow form: the overlapping pairs at least, those of the
/// rounded boxes at most.
pub fn allowed(boxes: &[Aabb], precision: &Precision) -> Allowed {
    Allowed { must: super::truth(boxes), may: truth(boxes, precision).pairs }
}

/// The allowed answers for boxes inflated by a margin. They contain every pair that can come to
/// overlap while faces move by no more than the margin, and no pair that needs faces farther
/// outward than the margin and two steps of f32.
pub fn allowed_by_margin(boxes: &[Aabb], margin: f32) -> Allowed {
    let (given, margin) = (boxes.iter().map(faces).collect::<Vec<Faces>>(), exact(margin));
    // One step of f64 inward of the sum, because the sum may have been rounded outward; never
    // inside the box.
    let least = |x: f64, _, up| {
        if up { (x + margin).next_down().max(x) } else { (x - margin).next_up().min(x) }
    };
    let most = |x: f64, _, up| beyond(if up { x + margin } else { x - margin }, up, 2);
    Allowed {
        must: Truth { pairs: rounded_pairs(&given, least), census: super::census(&given) },
        may: rounded_pairs(&given, most),
    }
}

/// The allowed answers for boxes of a world in f64 that are sent in f32 relative to an origin: the
/// overlapping pairs at least; at most those of the tightest f32 boxes, each face one step farther
/// outward.
pub fn allowed_around_origin(boxes: &[Faces], origin: [f64; 3]) -> Allowed {
    let most = |x: f64, axis: usize, up| beyond(x - origin[axis], up, 2);
    Allowed { must: truth_of_faces(boxes), may: rounded_pairs(boxes, most) }
}

/// The f32 that is `steps` steps outward of a number. The first step leads to the closest f32 on
/// that side.
fn beyond(x: f64, up: bool, steps: u32) -> f64 {
    let nearest = x as f32;
    let step = if up { f32::next_up } else { f32::next_down };
    let is_outward = if up { f64::from(nearest) >= x } else { f64::from(nearest) <= x };
    f64::from((u32::from(is_outward)..steps).fold(nearest, |x, _| step(x)))
}

/// Number of the cell that a coordinate lies in.
fn cell(x: f32, axis: usize, bounds: &Bounds, cells: f64) -> f64 {
    let (low, high) = (f64::from(bounds.low()[axis]), f64::from(bounds.high()[axis]));
    if low == high || f64::from(x) <= low {
        return 0.0;
    }
    let position = (f64::from(x) - low) * (cells / (high - low));
    position.floor().min(cells - 1.0)
}

/// All halves that are numbers, ±∞ included, in order.
static HALVES: LazyLock<Vec<f64>> = LazyLock::new(|| floats::with_default(halves));

fn halves() -> Vec<f64> {
    let positive = (0..=0x7c00u16).map(|bits| {
        let (exponent, fraction) = (i32::from(bits >> 10), f64::from(bits & 1023));
        match exponent {
            0 => fraction * 2.0f64.powi(-24),
            31 => f64::INFINITY,
            e => (1024.0 + fraction) * 2.0f64.powi(e - 25),
        }
    });
    let positive: Vec<f64> = positive.collect();
    let negative = positive.iter().rev().map(|x| -x);
    negative.chain(positive.iter().copied()).collect()
}

/// The closest half on one side.
fn half(x: f32, up: bool) -> f64 {
    let x = f64::from(x);
    if up {
        HALVES[HALVES.partition_point(|h| *h < x)]
    } else {
        HALVES[HALVES.partition_point(|h| *h <= x) - 1]
    }
}

/// Pairs of `expected` that `got` lacks. Both sorted.
pub fn missed(got: &[Pair], expected: &[Pair]) -> Vec<Pair> {
    expected.iter().filter(|pair| got.binary_search(pair).is_err()).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_found_on_both_sides() {
        assert_eq!((half(1.0, false), half(1.0, true)), (1.0, 1.0));
        assert_eq!((half(1e-9, false), half(1e-9, true)), (0.0, 2.0f64.powi(-24)));
        assert_eq!((half(-1e9, false), half(-1e9, true)), (f64::NEG_INFINITY, -65_504.0));
        assert_eq!(half(f32::NEG_INFINITY, false), f64::NEG_INFINITY);
        assert_eq!(half(f32::INFINITY, true), f64::INFINITY);
    }

    #[test]
    fn steps_outward_are_counted_from_the_closest() {
        let one_up = 1.0f32.next_up();
        assert_eq!(beyond(1.0, true, 1), 1.0);
        assert_eq!(beyond(1.0, true, 2), f64::from(one_up));
        assert_eq!(beyond(1.0 + 1e-12, true, 1), f64::from(one_up));
        assert_eq!(beyond(-1e300, false, 1), f64::NEG_INFINITY);
        assert_eq!(beyond(1e300, false, 2), f64::from(f32::MAX.next_down()));
    }

    #[test]
    fn an_origin_keeps_what_touches_and_adds_what_f32_cannot_report() {
        let unit = |x: f64| [[x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]];
        let world = [unit(1e9), unit(1e9 + 1.0), unit(1e9 + 2.0 + 2e-7), unit(1e9 + 9.0)];
        let allowed = allowed_around_origin(&world, [1e9, 0.0, 0.0]);
        assert_eq!(allowed.must.pairs, [[0, 1]]);
        assert_eq!(allowed.may, [[0, 1], [1, 2]]);
    }

    #[test]
    fn missed_pairs_are_those_that_only_the_truth_has() {
        assert_eq!(missed(&[[0, 1], [2, 3]], &[[0, 1], [0, 2]]), [[0, 2]]);
    }
}
