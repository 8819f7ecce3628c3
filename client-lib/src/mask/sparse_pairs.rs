//! Pairs of a sparse mask, with and without an order.

use std::iter::FusedIterator;

use super::sparse_words::{SparseWord, SparseWords};
use crate::units::BoxCount;

/// The pairs of the words of a sparse mask, in the order of the words, columns rising.
#[derive(Clone)]
pub(super) struct SparsePairs<'a> {
    n: BoxCount,
    order: Option<&'a [u32]>,
    /// The word in hand, without strays and without the bits that were given out.
    word: SparseWord,
    words: SparseWords<'a>,
}

impl<'a> SparsePairs<'a> {
    /// `order`, where there is one, has `n` positions.
    pub fn new(n: BoxCount, order: Option<&'a [u32]>, words: SparseWords<'a>) -> Self {
        Self { n, order, word: SparseWord { row: 0, block: 0, bits: 0 }, words }
    }
}

impl Iterator for SparsePairs<'_> {
    type Item = (u32, u32);

    #[inline]
    fn next(&mut self) -> Option<(u32, u32)> {
        loop {
            while let Some((row, column)) = take_bit(&mut self.word) {
                match self.order {
                    None => return Some((row, column)),
                    Some(order) => {
                        let ordered = Ordered::row(order, self.n, row);
                        if let Some(pair) = ordered.and_then(|o| o.pair(column)) {
                            return Some(pair);
                        }
                    }
                }
            }
            self.word = self.words.next()?.without_strays(self.n);
        }
    }

    #[inline]
    fn fold<B, F: FnMut(B, (u32, u32)) -> B>(self, init: B, mut f: F) -> B {
        let Self { n, order, word, words } = self;
        match order {
            None => {
                let mut of_word = |mut acc, mut word: SparseWord| {
                    while let Some(pair) = take_bit(&mut word) {
                        acc = f(acc, pair);
                    }
                    acc
                };
                let acc = of_word(init, word);
                words.fold(acc, |acc, word| of_word(acc, word.without_strays(n)))
            }
            Some(order) => {
                let mut of_word = |mut acc, mut word: SparseWord| {
                    let Some(ordered) = Ordered::row(order, n, word.row) else { return acc };
                    while let Some((_, column)) = take_bit(&mut word) {
                        if let Some(pair) = ordered.pair(column) {
                            acc = f(acc, pair);
                        }
                    }
                    acc
                };
                let acc = of_word(init, word);
                words.fold(acc, |acc, word| of_word(acc, word.without_strays(n)))
            }
        }
    }
}

impl FusedIterator for SparsePairs<'_> {}

/// Takes the lowest bit: the pair of positions that it names.
#[inline]
fn take_bit(word: &mut SparseWord) -> Option<(u32, u32)> {
    if word.bits == 0 {
        return None;
    }
    let column = word.column(word.bits.trailing_zeros());
    word.bits &= word.bits - 1;
    Some((word.row, column))
}

/// A row whose positions are turned into boxes.
struct Ordered<'a> {
    order: &'a [u32],
    n: u32,
    row_box: u32,
}

impl<'a> Ordered<'a> {
    /// `None` where the order has no such position.
    #[inline]
    fn row(order: &'a [u32], n: BoxCount, row: u32) -> Option<Self> {
        let row_box = *order.get(row as usize)?;
        Some(Self { order, n: n.get(), row_box })
    }

    /// Boxes of (row, column), smaller first; `None` where the order names no pair of boxes.
    #[inline]
    fn pair(&self, column: u32) -> Option<(u32, u32)> {
        let column_box = *self.order.get(column as usize)?;
        let (a, b) = (self.row_box.min(column_box), self.row_box.max(column_box));
        (a < b && b < self.n).then_some((a, b))
    }
}
