//! Types for counts and indices, so that they cannot be confused.

use bytemuck::{Pod, Zeroable};

/// Number of boxes in a scene: at most 2^32 − 1, so that an index fits in u32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BoxCount(u32);

impl BoxCount {
    /// A count of `n` boxes.
    pub const fn new(n: u32) -> Self {
        Self(n)
    }

    /// The count of a slice, or `None` past 2^32 − 1.
    pub fn of_len(len: usize) -> Option<Self> {
        u32::try_from(len).ok().map(Self)
    }

    /// The number itself.
    pub const fn get(self) -> u32 {
        self.0
    }

    /// The number as a slice length.
    pub const fn len(self) -> usize {
        self.0 as usize
    }

    /// Whether the count is 0.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// n(n − 1)/2. Fits u64 for every count.
    pub const fn pair_count(self) -> u64 {
        let n = self.0 as u64;
        if n == 0 { 0 } else { n * (n - 1) / 2 }
    }

    /// 32-bit words of a dense mask: one bit a pair, the tail zero.
    pub const fn dense_words(self) -> u64 {
        self.pair_count().div_ceil(32)
    }

    /// 32-bit words of a sparse mask in which no word is zero: the blocks of every row that hold
    /// a column after it.
    pub const fn sparse_words_max(self) -> u64 {
        let n = self.0 as u64;
        let (whole, rest) = (n / 32, n % 32);
        // Row r starts at block (r + 1)/32: take the blocks before it from all blocks.
        let before = if whole == 0 { 0 } else { 16 * whole * (whole - 1) + whole * (rest + 1) };
        n * self.column_blocks() as u64 - before
    }

    /// 32-column blocks of a row of a sparse mask.
    pub const fn column_blocks(self) -> u32 {
        self.0.div_ceil(32)
    }
}

/// Index k of a pair (a, b), a < b, numbered row by row from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PairIndex(u64);

impl PairIndex {
    /// The index `k`.
    pub const fn new(k: u64) -> Self {
        Self(k)
    }

    /// The number itself.
    pub const fn get(self) -> u64 {
        self.0
    }
}

/// 32 bits of a pair mask, one a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct MaskWord(pub u32);

impl MaskWord {
    /// Set bits, that is pairs.
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Whether no bit is set.
    pub const fn is_zero(self) -> bool {
        self.0 == 0
    }

    /// Positions of the set bits, lowest first.
    pub fn bits(self) -> impl Iterator<Item = u32> {
        let mut rest = self.0;
        std::iter::from_fn(move || {
            let bit = (rest != 0).then(|| rest.trailing_zeros())?;
            rest &= rest - 1;
            Some(bit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::BoxCount;

    #[test]
    fn sparse_words_max_counts_the_blocks_after_each_row() {
        for n in (0..200u32).chain([1234]) {
            let count = BoxCount::new(n);
            let blocks = u64::from(count.column_blocks());
            let counted: u64 = (0..n).map(|row| blocks - u64::from((row + 1) / 32)).sum();
            assert_eq!(count.sparse_words_max(), counted, "{n} boxes");
        }
        assert_eq!(BoxCount::new(u32::MAX).sparse_words_max() >> 57, 2);
    }
}
