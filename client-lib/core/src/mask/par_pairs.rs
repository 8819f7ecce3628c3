//! Pairs of a mask on many threads, split by ranges of words.

use std::ops::Range;

use rayon::iter::ParallelIterator;
use rayon::iter::plumbing::{Folder as _, Reducer as _, UnindexedConsumer};

use super::MaskView;
use super::word_flags::CHUNK_WORDS;

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
    type Item = [u32; 2];

    /// Ranges as short as is worth a thread, however few threads there are: with one range a thread,
    /// the last to finish holds up the others, by half of the time where 15 of them share 16 ranges.
    fn drive_unindexed<C: UnindexedConsumer<Self::Item>>(self, consumer: C) -> C::Result {
        drive(&self.mask, 0..range_count(&self.mask), consumer)
    }
}

/// Halves down to single ranges. Rayon's own bridges hand pairs on one by one, which takes longer
/// than decoding them.
fn drive<C: UnindexedConsumer<[u32; 2]>>(
    mask: &MaskView<'_>,
    parts: Range<usize>,
    consumer: C,
) -> C::Result {
    if consumer.full() {
        return consumer.into_folder().complete();
    }
    if parts.len() <= 1 {
        return mask.pairs_in(range(mask, parts.start)).feed(consumer.into_folder()).complete();
    }
    let middle = parts.start.midpoint(parts.end);
    let (low, reducer) = (consumer.split_off_left(), consumer.to_reducer());
    let (low, high) = rayon::join(
        || drive(mask, parts.start..middle, low),
        || drive(mask, middle..parts.end, consumer),
    );
    reducer.reduce(low, high)
}

/// Ranges that a mask is shared out in.
fn range_count(mask: &MaskView<'_>) -> usize {
    (mask.word_count() / mask.grain_words()).max(1)
}

/// The words of one of them: all are about as long, and begin where a chunk does.
fn range(mask: &MaskView<'_>, part: usize) -> Range<usize> {
    let (words, parts) = (mask.word_count(), range_count(mask));
    // No product of part and words, which may be too large.
    let length = (words / parts).next_multiple_of(CHUNK_WORDS);
    let border = |part: usize| if part == parts { words } else { (part * length).min(words) };
    border(part)..border(part + 1)
}
