//! Precision modes by their definitions: which pairs each mode has to report, found naively.
//!
//! Nothing of the library's conversions is used: cells are f64 arithmetic with `floor`, halves are
//! searched for in a table of all of them.

use std::sync::LazyLock;

use pairmask::{Aabb, Bounds, Precision};

use crate::oracle::{self, Pair, Truth};

/// What a mode has to answer: the pairs of the rounded boxes, and the census of the given ones.
pub fn truth(boxes: &[Aabb], precision: &Precision) -> Truth {
    let round = |x: f32, axis: usize, up: bool| match precision {
        Precision::Exact => f64::from(x),
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
    let exact = oracle::truth(boxes);
    let corners: Vec<Option<[[f64; 3]; 2]>> = boxes
        .iter()
        .map(|b| {
            let solid = (0..3).all(|axis| f64::from(b.min[axis]) <= f64::from(b.max[axis]));
            solid.then(|| {
                [
                    std::array::from_fn(|axis| round(b.min[axis], axis, false)),
                    std::array::from_fn(|axis| round(b.max[axis], axis, true)),
                ]
            })
        })
        .collect();
    let mut pairs = Vec::new();
    for (a, p) in corners.iter().enumerate() {
        for (b, q) in corners.iter().enumerate().skip(a + 1) {
            if let (Some(p), Some(q)) = (p, q)
                && (0..3).all(|axis| p[0][axis] <= q[1][axis] && q[0][axis] <= p[1][axis])
            {
                pairs.push((a as u32, b as u32));
            }
        }
    }
    Truth { pairs, census: exact.census }
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
static HALVES: LazyLock<Vec<f64>> = LazyLock::new(|| {
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
});

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
    fn missed_pairs_are_those_that_only_the_truth_has() {
        assert_eq!(missed(&[(0, 1), (2, 3)], &[(0, 1), (0, 2)]), [(0, 2)]);
    }
}
