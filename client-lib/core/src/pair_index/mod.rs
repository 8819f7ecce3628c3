//! The pair index: k ↔ (a, b), exact for every number of boxes.
//!
//! Pairs (a, b) with a < b are numbered row by row from 0. For n boxes:
//!
//! | | here, boxes from 0 | papers, boxes from 1 |
//! |---|---|---|
//! | first pair of row a | S(a) = a(2n − a − 1)/2 | S(a) = (a − 1)(2n − a)/2 |
//! | index of pair (a, b) | k = S(a) + b − a − 1 | k = S(a) + b − (a + 1) |
//! | pairs | n(n − 1)/2 | n(n − 1)/2 |
//!
//! k is the same number in both; only the names of the boxes differ by one.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §3.2 for the numbering. The inverse is not the
//! paper's: its closed form subtracts two numbers of like size, and in f32 that is wrong soon after
//! n = 4096. This one counts from the far end.
//!
//! # The inverse, and why it is exact
//!
//! Let m = n(n − 1)/2 − 1 − k be the number of pairs after k. From the far end the rows hold
//! 1, 2, 3, … pairs, so t(t + 1)/2 pairs lie in the t rows after row n − 2 − t. Hence
//!
//! * t is the largest integer with t(t + 1) ≤ x, where x = 2m;
//! * a = n − 2 − t, and b = n − 1 − (m − t(t + 1)/2).
//!
//! The guess is g = ⌊√x⌋ in f64. It is t or t + 1, for every n up to 2^32 − 1:
//!
//! * x < 2^64. Both the conversion of x and IEEE 754's √ have a relative error of at most 2^−53,
//!   so the computed root is within 2^32 · 2^−52 = 2^−20 of √x. (Any rounding mode doubles that
//!   at most.)
//! * From below: t = 0 means x = 0, whose root is exact. For t ≥ 1, √x ≥ √(t² + t) ≥ t + 0.41,
//!   so the computed root is above t.
//! * From above: x is even and less than (t + 1)(t + 2), so x ≤ t² + 3t < (t + 3/2)², and the
//!   computed root is below t + 2.
//!
//! One integer comparison distinguishes t from t + 1: g is too large exactly when g(g + 1) > x. As
//! t ≤ n − 2 ≤ 2^32 − 3, the product is at most (2^32 − 2)(2^32 − 1) and stays in u64.

mod walker;

#[cfg(test)]
mod tests;

pub use walker::PairWalker;

use crate::units::{BoxCount, PairIndex};

/// Index of the first pair of row `a`: S(a) = a(2n − a − 1)/2, with `a` counted from 0.
///
/// Rows from n − 1 on hold no pair: their start is the number of pairs.
#[inline]
#[must_use]
pub const fn row_start(n: BoxCount, a: u32) -> u64 {
    // Counted from the far end, the products stay in u64: rows `a` to n − 2 hold 1 + … + j pairs.
    let j = n.get().saturating_sub(1).saturating_sub(a) as u64;
    n.pair_count() - j * (j + 1) / 2
}

impl PairIndex {
    /// Index of pair (a, b) among `n` boxes, or `None` unless a < b < n.
    #[inline]
    #[must_use]
    pub const fn of(n: BoxCount, a: u32, b: u32) -> Option<Self> {
        if a < b && b < n.get() {
            Some(Self::new(row_start(n, a) + (b - a - 1) as u64))
        } else {
            None
        }
    }

    /// The pair (a, b) of this index, a < b < n, or `None` past the last pair of `n` boxes.
    ///
    /// Exact for every `n`; the proof is at the head of [the module](crate::pair_index).
    #[inline]
    #[must_use]
    pub fn pair(self, n: BoxCount) -> Option<[u32; 2]> {
        let after = n.pair_count().checked_sub(self.get())?.checked_sub(1)?;
        let x = 2 * after;
        let guess = (x as f64).sqrt() as u64;
        let t = guess - u64::from(guess * (guess + 1) > x);
        let last = n.get() - 1;
        Some([last - 1 - t as u32, last - (after - t * (t + 1) / 2) as u32])
    }
}
