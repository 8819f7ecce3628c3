//! A list of pairs: what masks are weighed against.

/// Two boxes a pair, the lower one first.
#[derive(Clone, Debug)]
pub(super) struct PairList {
    pub pairs: Vec<[u32; 2]>,
}

impl PairList {
    pub fn bytes(&self) -> u64 {
        8 * self.pairs.len() as u64
    }

    /// Gives every pair of `n` boxes, and drops what is none, as a decoder of a mask does.
    #[inline(always)]
    pub fn walk(&self, n: u32, mut take: impl FnMut(u32, u32)) {
        self.pairs.iter().filter(|[a, b]| a < b && *b < n).for_each(|[a, b]| take(*a, *b));
    }
}
