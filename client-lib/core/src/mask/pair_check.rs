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

/// Vector code of whatever instruction set its caller is compiled for: no branch on any single pair.
#[inline(always)]
pub(super) fn plain(pairs: &[[u32; 2]], n: BoxCount) -> bool {
    pairs.iter().fold(true, |all, [a, b]| all & (a < b) & (*b < n.get()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isa::{AvailableIsa, Isa};

    #[test]
    fn every_instruction_set_sees_each_stray() {
        for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
            for len in (0..70).chain([256, 345]) {
                let n = BoxCount::new(1_234);
                let mut pairs: Vec<[u32; 2]> = (0..len).map(|i| [i, 1_233 - i]).collect();
                assert!(are_pairs(&pairs, n, isa), "{isa:?} {len}");
                for at in 0..pairs.len() {
                    for stray in [[5, 5], [6, 5], [0, 1_234], [u32::MAX - 1, u32::MAX]] {
                        let good = std::mem::replace(&mut pairs[at], stray);
                        assert!(!are_pairs(&pairs, n, isa), "{isa:?} {at} of {len}: {stray:?}");
                        pairs[at] = good;
                    }
                }
                assert!(len == 0 || !are_pairs(&pairs, BoxCount::new(0), isa));
            }
        }
    }
}
