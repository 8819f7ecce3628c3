//! Pairs of a mask on many threads, split by ranges of words.

use std::ops::Range;

use rayon::iter::ParallelIterator;
use rayon::iter::plumbing::{Folder, UnindexedConsumer, UnindexedProducer, bridge_unindexed};

use super::MaskView;
use super::word_flags::CHUNK_WORDS;

/// Smallest range of a dense mask worth a thread, words: 512 KiB, which one thread scans in 10 to
/// 20 µs. Waking another thread takes as long, so smaller ranges would cost time.
const DENSE_GRAIN_WORDS: usize = 2048 * CHUNK_WORDS;

/// Smallest range of a sparse mask worth a thread, words: at about 1 ns a word some 15 µs, as above.
const SPARSE_GRAIN_WORDS: usize = 1 << 14;

/// The pairs of a mask as a parallel iterator, from
/// [`MaskView::par_pairs`](super::MaskView::par_pairs).
///
/// Collecting keeps the order of [`MaskView::pairs`](super::MaskView::pairs).
#[derive(Clone)]
pub struct ParPairs<'a> {
    mask: MaskView<'a>,
}

impl<'a> ParPairs<'a> {
    pub(super) const fn new(mask: MaskView<'a>) -> Self {
        Self { mask }
    }
}

impl ParallelIterator for ParPairs<'_> {
    type Item = (u32, u32);

    fn drive_unindexed<C: UnindexedConsumer<Self::Item>>(self, consumer: C) -> C::Result {
        let range = 0..self.mask.word_count();
        let grain = match self.mask {
            MaskView::Dense(_) => DENSE_GRAIN_WORDS,
            MaskView::Sparse(_) => SPARSE_GRAIN_WORDS,
        };
        bridge_unindexed(WordRange { mask: self.mask, range, grain }, consumer)
    }
}

/// A range of words that one thread decodes, or splits in two.
struct WordRange<'a> {
    mask: MaskView<'a>,
    range: Range<usize>,
    grain: usize,
}

impl UnindexedProducer for WordRange<'_> {
    type Item = (u32, u32);

    fn split(self) -> (Self, Option<Self>) {
        let Self { mask, range, grain } = self;
        let half = (range.len() / 2).next_multiple_of(CHUNK_WORDS);
        if range.len() < 2 * grain {
            return (Self { mask, range, grain }, None);
        }
        let middle = range.start + half;
        let right = Self { mask, range: middle..range.end, grain };
        (Self { mask, range: range.start..middle, grain }, Some(right))
    }

    fn fold_with<F: Folder<Self::Item>>(self, folder: F) -> F {
        folder.consume_iter(self.mask.pairs_in(self.range))
    }
}
