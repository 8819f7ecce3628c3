//! Stepping from pair to pair: one inverse, then additions only.

use crate::units::{BoxCount, PairIndex};

/// A pair that moves forward in index order without a square root.
///
/// The dense decoder starts one at the first set bit of a word and steps to the others: 32
/// consecutive pairs mostly lie in one row, and then a step is one addition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PairWalker {
    n: BoxCount,
    a: u32,
    b: u32,
}

impl PairWalker {
    /// A walker at pair `k` of `n` boxes, or `None` past the last pair.
    #[inline]
    #[must_use]
    pub fn start(n: BoxCount, k: PairIndex) -> Option<Self> {
        k.pair(n).map(|[a, b]| Self { n, a, b })
    }

    /// The pair (a, b), a < b < n.
    #[inline]
    #[must_use]
    pub const fn pair(&self) -> [u32; 2] {
        [self.a, self.b]
    }

    /// The walker `distance` pairs further, or `None` past the last pair.
    ///
    /// Takes a step for each row that it passes: for far jumps, [`PairWalker::start`] is cheaper.
    #[inline]
    #[must_use]
    pub const fn advance(self, distance: u32) -> Option<Self> {
        let end = self.n.get() as u64;
        let mut a = self.a as u64;
        let mut b = self.b as u64 + distance as u64;
        while b >= end {
            // The part beyond row a continues at (a + 1, a + 2).
            b = b - end + a + 2;
            a += 1;
            if a + 1 >= end {
                return None;
            }
        }
        Some(Self { n: self.n, a: a as u32, b: b as u32 })
    }
}
