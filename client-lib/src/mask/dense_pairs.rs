//! Pairs of a dense mask: one inverse of the pair index a word, then stepping.

use std::iter::FusedIterator;

use super::dense_words::DenseWords;
use crate::pair_index::PairWalker;
use crate::units::{BoxCount, PairIndex};

/// The pairs of the words of a dense mask, in index order.
#[derive(Clone)]
pub(super) struct DensePairs<'a> {
    n: BoxCount,
    word: WordPairs,
    words: DenseWords<'a>,
}

impl<'a> DensePairs<'a> {
    pub fn new(n: BoxCount, words: DenseWords<'a>) -> Self {
        Self { n, word: WordPairs { next: None, ahead: 0 }, words }
    }
}

impl Iterator for DensePairs<'_> {
    type Item = (u32, u32);

    #[inline]
    fn next(&mut self) -> Option<(u32, u32)> {
        loop {
            if let Some(pair) = self.word.next() {
                return Some(pair);
            }
            let (number, bits) = self.words.next()?;
            self.word = WordPairs::of(self.n, number, bits);
        }
    }

    #[inline]
    fn fold<B, F: FnMut(B, (u32, u32)) -> B>(self, init: B, mut f: F) -> B {
        let init = self.word.fold(init, &mut f);
        self.words
            .fold(init, |acc, (number, bits)| WordPairs::of(self.n, number, bits).fold(acc, &mut f))
    }
}

impl FusedIterator for DensePairs<'_> {}

/// The pairs of one word.
#[derive(Clone)]
struct WordPairs {
    /// Stands at the pair that comes next.
    next: Option<PairWalker>,
    /// The bits behind it: bit 0 is the pair after it.
    ahead: u32,
}

impl WordPairs {
    /// Word `number` of the mask of `n` boxes. `bits` are not zero.
    #[inline]
    fn of(n: BoxCount, number: usize, bits: u32) -> Self {
        let skipped = bits.trailing_zeros();
        let first = PairIndex::new(32 * number as u64 + u64::from(skipped));
        // Two shifts: one by 32 would overflow when only bit 31 is set.
        Self {
            next: PairWalker::start(n, first),
            ahead: bits.checked_shr(skipped).unwrap_or(0) >> 1,
        }
    }
}

impl Iterator for WordPairs {
    type Item = (u32, u32);

    #[inline]
    fn next(&mut self) -> Option<(u32, u32)> {
        let here = self.next?;
        self.next = if self.ahead == 0 {
            None
        } else {
            let skipped = self.ahead.trailing_zeros();
            self.ahead = self.ahead >> skipped >> 1;
            here.advance(skipped + 1)
        };
        Some(here.pair())
    }
}
