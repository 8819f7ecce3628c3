//! Pairs of a dense mask: one inverse of the pair index a word, then stepping.

use super::dense_words::DenseWords;
use crate::mask::pair_buffer::{PairWriter, WORD_PAIRS};
use crate::mask::word_flags::flags_by;
use crate::pair_index::PairWalker;
use crate::simd::per_isa;
use crate::units::{BoxCount, PairIndex};

/// The pairs of the words of a dense mask, in index order.
#[derive(Clone)]
pub(in crate::mask) struct DensePairs<'a> {
    n: BoxCount,
    words: DenseWords<'a>,
}

impl<'a> DensePairs<'a> {
    pub const fn new(n: BoxCount, words: DenseWords<'a>) -> Self {
        Self { n, words }
    }

    /// Puts the pairs of words until there is no more room. False at the end of the mask.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let isa = self.words.isa();
        write(self, writer, isa)
    }
}

per_isa! {
    fn write<simd: S>(pairs: &mut DensePairs<'_>, writer: &mut PairWriter) -> bool {
        let mut more = false;
        while writer.has_room_for(WORD_PAIRS) {
            let Some((number, bits)) = pairs.words.next_by(|chunk| flags_by(simd, chunk)) else { break };
            more = true;
            put_word(pairs.n, number, bits, writer);
        }
        more
    }
}

/// Adds the pairs of word `number`, which is not zero.
#[inline(always)]
fn put_word(n: BoxCount, number: usize, mut bits: u32, writer: &mut PairWriter) {
    let mut at = bits.trailing_zeros();
    let first = PairIndex::new(WORD_PAIRS as u64 * number as u64 + u64::from(at));
    let Some(mut here) = PairWalker::start(n, first) else { return };
    let [a, b] = here.pair();
    if u64::from(b) + WORD_PAIRS as u64 <= u64::from(n.get()) {
        // All in one row, as nearly always: no pair has to wait for the one before it.
        while bits != 0 {
            writer.put_if(true, [a, b + (bits.trailing_zeros() - at)]);
            bits &= bits - 1;
        }
        return;
    }
    loop {
        writer.put_if(true, here.pair());
        bits &= bits.wrapping_sub(1);
        if bits == 0 {
            return;
        }
        let next = bits.trailing_zeros();
        let Some(there) = here.advance(next - at) else { return };
        (here, at) = (there, next);
    }
}
