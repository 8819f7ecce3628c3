//! Pairs of a sparse mask, with and without an order.

#[cfg(target_arch = "x86_64")]
mod avx512;

use super::pair_buffer::PairWriter;
use super::sparse_words::{SparseWord, SparseWords};
use crate::engine::{AvailableIsa, Isa};
use crate::units::BoxCount;

/// Most pairs of a word.
const WORD_PAIRS: usize = 32;

/// The pairs of the words of a sparse mask, in the order of the words, columns rising.
#[derive(Clone)]
pub(super) struct SparsePairs<'a> {
    n: BoxCount,
    /// `n` positions, where there is one.
    order: Option<&'a [u32]>,
    words: SparseWords<'a>,
    isa: AvailableIsa,
}

impl<'a> SparsePairs<'a> {
    pub fn new(n: BoxCount, order: Option<&'a [u32]>, words: SparseWords<'a>) -> Self {
        Self { n, order, words, isa: AvailableIsa::best() }
    }

    /// Puts the pairs of words until there is no more room. False at the end of the mask; nothing
    /// may be put before it, where the mask is malformed.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let rest = match self.isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512::write(self, writer, self.isa),
            _ => self.write_portable(writer),
        };
        rest.map(|rest| self.words = rest).is_some()
    }

    /// Puts the pairs of words, one word after the other. The words left over, or `None` at the
    /// end.
    fn write_portable(&self, writer: &mut PairWriter) -> Option<SparseWords<'a>> {
        let (word, mut rest) = self.words.split_first()?;
        put_word(word, writer);
        while writer.has_room_for(WORD_PAIRS) {
            let Some((word, after)) = rest.split_first() else { break };
            put_word(word, writer);
            rest = after;
        }
        writer.drop_strays(self.n);
        self.name_boxes(writer);
        Some(rest)
    }

    /// Turns positions into boxes.
    #[inline(always)]
    fn name_boxes(&self, writer: &mut PairWriter) {
        if let Some(order) = self.order {
            writer.name_boxes(order);
            writer.drop_strays(self.n);
        }
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
