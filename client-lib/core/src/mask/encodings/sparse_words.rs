//! Words of a sparse mask and the bits of each that name a pair.

use crate::units::BoxCount;

/// A word of a sparse mask: bit t is the pair of positions (row, 32·block + t).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::mask) struct SparseWord {
    pub row: u32,
    pub block: u32,
    pub bits: u32,
}

impl SparseWord {
    /// The bits that may be set: columns after the row and before `n`.
    ///
    /// Without a branch, since whether a word lies on the diagonal is hard to predict.
    #[inline]
    pub const fn valid_mask(&self, n: BoxCount) -> u32 {
        let (row_block, last_block) = (self.row / 32, n.get() / 32);
        let after_row = match () {
            () if self.block > row_block => u32::MAX,
            () if self.block == row_block => (u32::MAX - 1) << (self.row % 32),
            () => 0,
        };
        let before_n = match () {
            () if self.block < last_block => u32::MAX,
            () if self.block == last_block => !(u32::MAX << (n.get() % 32)),
            () => 0,
        };
        after_row & before_n
    }

    /// The word without bits that name no pair of `n` boxes.
    #[inline]
    pub fn without_strays(self, n: BoxCount) -> Self {
        Self { bits: self.bits & self.valid_mask(n), ..self }
    }
}

/// Words of a sparse mask as they lie in the reply: three slices of one length.
#[derive(Clone)]
pub(in crate::mask) struct SparseWords<'a> {
    rows: &'a [u32],
    blocks: &'a [u32],
    bits: &'a [u32],
}

impl<'a> SparseWords<'a> {
    /// As many words as the shortest slice has.
    pub fn new(rows: &'a [u32], blocks: &'a [u32], bits: &'a [u32]) -> Self {
        let len = rows.len().min(blocks.len()).min(bits.len());
        let cut = |words: &'a [u32]| words.get(..len).unwrap_or(&[]);
        Self { rows: cut(rows), blocks: cut(blocks), bits: cut(bits) }
    }

    #[inline(always)]
    pub fn split_first(&self) -> Option<(SparseWord, Self)> {
        let (row, rows) = self.rows.split_first()?;
        let (block, blocks) = self.blocks.split_first()?;
        let (bits, rest) = self.bits.split_first()?;
        let word = SparseWord { row: *row, block: *block, bits: *bits };
        Some((word, Self { rows, blocks, bits: rest }))
    }

    /// The blocks of words `start` to `start + N − 1`, if there are so many.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn blocks_from<const N: usize>(&self, start: usize) -> Option<&'a [u32; N]> {
        self.blocks.get(start..)?.first_chunk()
    }

    /// The words without the first `count`.
    #[inline(always)]
    pub fn without_first(&self, count: usize) -> Self {
        let after = |words: &'a [u32]| words.get(count..).unwrap_or(&[]);
        Self { rows: after(self.rows), blocks: after(self.blocks), bits: after(self.bits) }
    }

    /// The first `N` words (rows, blocks, bits) and those after them.
    #[inline(always)]
    pub fn split_first_chunk<const N: usize>(&self) -> Option<([&'a [u32; N]; 3], Self)> {
        let (row, rows) = self.rows.split_first_chunk()?;
        let (block, blocks) = self.blocks.split_first_chunk()?;
        let (bits, rest) = self.bits.split_first_chunk()?;
        Some(([row, block, bits], Self { rows, blocks, bits: rest }))
    }
}

impl Iterator for SparseWords<'_> {
    type Item = SparseWord;

    #[inline]
    fn next(&mut self) -> Option<SparseWord> {
        let (word, rest) = self.split_first()?;
        *self = rest;
        Some(word)
    }
}
