//! Pairs of a sparse mask, with and without an order.

use super::pair_buffer::PairWriter;
use super::sparse_words::{SparseWord, SparseWords};
use crate::units::BoxCount;

/// The pairs of the words of a sparse mask, in the order of the words, columns rising.
#[derive(Clone)]
pub(super) struct SparsePairs<'a> {
    n: BoxCount,
    /// `n` positions, where there is one.
    order: Option<&'a [u32]>,
    words: SparseWords<'a>,
}

impl<'a> SparsePairs<'a> {
    pub fn new(n: BoxCount, order: Option<&'a [u32]>, words: SparseWords<'a>) -> Self {
        Self { n, order, words }
    }

    /// Puts the pairs of words until there is no more room. False at the end of the mask; nothing
    /// may be put before it, where the mask is malformed.
    #[inline(always)]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let mut more = false;
        while writer.has_room() {
            let Some(word) = self.words.next() else { break };
            more = true;
            put_word(word, writer);
        }
        match self.order {
            None => writer.settle(self.n, |pair| pair),
            Some(order) => writer.settle(self.n, |(row, column)| boxes_at(order, row, column)),
        }
        more
    }
}

/// Adds the pairs of positions of a word, strays included.
#[inline(always)]
fn put_word(word: SparseWord, writer: &mut PairWriter) {
    // A block behind the last column that there can be: position 2^32 − 1 is never a box.
    let first_column = if word.block < 1 << 27 { word.block << 5 } else { u32::MAX };
    // The or keeps a zero word, which is not put, from asking for its lowest bit.
    let lowest = |bits: u32| (word.row, first_column | (bits | 1 << 31).trailing_zeros());
    let mut bits = word.bits;
    // Two without a branch: few words have more, and those that do are worth a wrong guess.
    for _ in 0..2 {
        writer.put_if(bits != 0, lowest(bits));
        bits &= bits.wrapping_sub(1);
    }
    while bits != 0 {
        writer.put_if(true, lowest(bits));
        bits &= bits - 1;
    }
}

/// The boxes at two positions, smaller first, or twice 2^32 − 1, which is no box.
#[inline(always)]
fn boxes_at(order: &[u32], row: u32, column: u32) -> (u32, u32) {
    match (order.get(row as usize), order.get(column as usize)) {
        (Some(&p), Some(&q)) if row < column => (p.min(q), p.max(q)),
        _ => (u32::MAX, u32::MAX),
    }
}
