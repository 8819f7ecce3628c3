//! Words of a sparse mask and the bits of each that name a pair.

use std::iter::FusedIterator;
use std::{iter, slice};

use crate::units::BoxCount;

/// A word of a sparse mask: bit t is the pair of positions (row, 32·block + t).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SparseWord {
    pub row: u32,
    pub block: u32,
    pub bits: u32,
}

impl SparseWord {
    /// The bits that may be set: columns after the row and before `n`.
    ///
    /// Without a branch, since whether a word lies on the diagonal is hard to predict.
    #[inline]
    pub fn valid_mask(&self, n: BoxCount) -> u32 {
        let first_column = 32 * u64::from(self.block);
        let from = (u64::from(self.row) + 1).saturating_sub(first_column).min(32);
        let to = u64::from(n.get()).saturating_sub(first_column).min(32);
        ((u64::MAX << from) & !(u64::MAX << to)) as u32
    }

    /// The word without bits that name no pair of `n` boxes.
    #[inline]
    pub fn without_strays(self, n: BoxCount) -> Self {
        Self { bits: self.bits & self.valid_mask(n), ..self }
    }

    /// Column of bit `t`. A bit of the valid mask has one below 2^32.
    #[inline]
    pub fn column(&self, t: u32) -> u32 {
        (self.block << 5) | t
    }
}

/// The words of a sparse mask as they lie in the reply.
#[derive(Clone)]
pub(super) struct SparseWords<'a> {
    addresses: iter::Zip<slice::Iter<'a, u32>, slice::Iter<'a, u32>>,
    bits: slice::Iter<'a, u32>,
}

impl<'a> SparseWords<'a> {
    pub fn new(rows: &'a [u32], blocks: &'a [u32], bits: &'a [u32]) -> Self {
        Self { addresses: rows.iter().zip(blocks), bits: bits.iter() }
    }
}

impl Iterator for SparseWords<'_> {
    type Item = SparseWord;

    #[inline]
    fn next(&mut self) -> Option<SparseWord> {
        let ((row, block), bits) = (self.addresses.next()?, self.bits.next()?);
        Some(SparseWord { row: *row, block: *block, bits: *bits })
    }

    #[inline]
    fn fold<B, F: FnMut(B, SparseWord) -> B>(self, init: B, mut f: F) -> B {
        self.addresses.zip(self.bits).fold(init, |acc, ((row, block), bits)| {
            f(acc, SparseWord { row: *row, block: *block, bits: *bits })
        })
    }
}

impl FusedIterator for SparseWords<'_> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_mask_equals_its_definition() {
        let edges = [0, 1, 2, 30, 31, 32, 33, 63, 64, 65, 345, 1 << 27, u32::MAX - 32, u32::MAX];
        for n in edges.map(BoxCount::new) {
            for row in edges {
                for block in [0, 1, 2, 10, (1 << 27) - 2, (1 << 27) - 1, 1 << 27, u32::MAX] {
                    let word = SparseWord { row, block, bits: u32::MAX };
                    let expected = (0..32).fold(0u32, |mask, t| {
                        let column = 32 * u64::from(block) + t;
                        let valid = u64::from(row) < column && column < u64::from(n.get());
                        mask | u32::from(valid) << t
                    });
                    assert_eq!(word.valid_mask(n), expected, "{n:?} {row} {block}");
                    for t in (0..32).filter(|t| expected >> t & 1 != 0) {
                        assert_eq!(u64::from(word.column(t)), 32 * u64::from(block) + u64::from(t));
                    }
                }
            }
        }
    }
}
