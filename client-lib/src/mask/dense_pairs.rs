//! Pairs of a dense mask: one inverse of the pair index a word, then stepping.

use super::dense_words::DenseWords;
use super::pair_buffer::PairWriter;
use crate::pair_index::PairWalker;
use crate::units::{BoxCount, PairIndex};

/// The pairs of the words of a dense mask, in index order.
#[derive(Clone)]
pub(super) struct DensePairs<'a> {
    n: BoxCount,
    words: DenseWords<'a>,
}

impl<'a> DensePairs<'a> {
    pub fn new(n: BoxCount, words: DenseWords<'a>) -> Self {
        Self { n, words }
    }

    /// Puts the pairs of words until there is no more room. False at the end of the mask.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let mut more = false;
        while writer.has_room_for(32) {
            let Some((number, bits)) = self.words.next() else { break };
            more = true;
            put_word(self.n, number, bits, writer);
        }
        more
    }
}

/// Adds the pairs of word `number`.
#[inline]
fn put_word(n: BoxCount, number: usize, bits: u32, writer: &mut PairWriter) {
    let skipped = bits.trailing_zeros();
    let first = PairIndex::new(32 * number as u64 + u64::from(skipped));
    let Some(mut here) = PairWalker::start(n, first) else { return };
    writer.put_if(true, here.pair());
    // Two shifts: one by 32 would overflow when only bit 31 is set.
    let mut ahead = bits.checked_shr(skipped).unwrap_or(0) >> 1;
    while ahead != 0 {
        let skipped = ahead.trailing_zeros();
        ahead = ahead >> skipped >> 1;
        let Some(next) = here.advance(skipped + 1) else { return };
        here = next;
        writer.put_if(true, here.pair());
    }
}
