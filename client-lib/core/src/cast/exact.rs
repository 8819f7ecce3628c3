//! The sign of a sum of f64, without rounding: Shewchuk 1997, "Adaptive Precision Floating-Point Arithmetic and Fast
//! Robust Geometric Predicates" (Grow-Expansion with zeros left out).

use std::cmp::Ordering;

use crate::floats::{self, two_sum};

/// Most terms of a sum: two distances of nine each.
const MOST_TERMS: usize = 18;

/// Relative errors of what is computed in f64 here are below this: six roundings, with room.
pub(super) const ERROR: f64 = 1.0 / (1u64 << 48) as f64;

/// How the sum of some finite numbers compares with 0. Their sums must not overflow, which products of two f32 do
/// not.
///
/// # Panics
/// With more than 18 terms.
pub(super) fn sign_of_sum(terms: impl IntoIterator<Item = f64>) -> Ordering {
    debug_assert!(floats::are_default());
    // Of increasing magnitude, and no bit of one overlaps another: the last one has the sign.
    let mut parts = [0.0; MOST_TERMS];
    let mut count = 0;
    for term in terms {
        let mut sum = term;
        let mut kept = 0;
        for at in 0..count {
            let (rounded, rest) = two_sum(sum, parts[at]);
            if rest != 0.0 {
                parts[kept] = rest;
                kept += 1;
            }
            sum = rounded;
        }
        count = kept;
        if sum != 0.0 {
            parts[count] = sum;
            count += 1;
        }
    }
    let last = parts[..count].last().copied().unwrap_or(0.0);
    last.partial_cmp(&0.0).unwrap_or(Ordering::Equal)
}
