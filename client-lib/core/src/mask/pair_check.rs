//! Whether some pairs are pairs of the boxes there are, as fast as the first-level cache is read.
// `&` instead of `&&`: a branch on each pair costs more than the second operand.
#![allow(clippy::needless_bitwise_bool)]

use crate::simd::per_isa;
use crate::units::BoxCount;

per_isa! {
    /// Whether all of `pairs` are pairs of `n` boxes, smaller index first.
    pub(super) fn are_pairs<simd: S>(pairs: &[[u32; 2]], n: BoxCount) -> bool {
        let _ = simd;
        plain(pairs, n)
    }
}

/// Vector code of any instruction set its caller is compiled for: no branch on any single pair.
#[inline(always)]
pub(super) fn plain(pairs: &[[u32; 2]], n: BoxCount) -> bool {
    pairs.iter().fold(true, |all, [a, b]| all & (a < b) & (*b < n.get()))
}
