//! The sparse encoding: the words of all tasks behind one another, in three arrays, and the order.

use super::{EncodingCost, FoundWords};
use crate::cancel::{Cancel, Pace};
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::{MaskShape, SECTION_ALIGN_WORDS};
use crate::stats::SceneStats;
use crate::team::for_each_in_parts;

/// What sparse masks take.
pub(super) const COST: EncodingCost = EncodingCost {
    // A pair: kept, and written.
    write: &[CostTerm::new(0.395, |stats, _| stats.expected_pairs())],
    iterate: &[
        CostTerm::new(122.0, |_, _| 1.0),
        // A pair of boxes in their own order.
        CostTerm::new(1.15, |stats, _| stats.expected_pairs()),
        // More for a pair in an order of the engine's.
        CostTerm::avx512_or(0.486, 1.2, SceneStats::ordered_pairs),
    ],
    // Words hold about a pair each.
    bytes: |stats, has_order| {
        let order = if has_order { ORDER_BYTES * stats.boxes() } else { 0.0 };
        WORD_BYTES * stats.expected_pairs() + order
    },
};

/// Bytes of a word: row, block and bits.
const WORD_BYTES: f64 = 12.0;
const ORDER_BYTES: f64 = 4.0;

/// A word that is copied, in tests of boxes.
const WORD_TESTS: u64 = 4;

/// Fewest words that are worth a second thread.
const PARALLEL_WORDS: usize = 16 * 1024;

/// Writes the words of all tasks and says where they lie.
pub(super) fn write<'a, W, T>(
    tasks: &T,
    gather: &Gather<'_>,
    parallel: bool,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError>
where
    W: FoundWords + 'a,
    T: Iterator<Item = &'a W> + Clone + Send + Sync,
{
    let Gather { budget, order, .. } = *gather;
    let word_count = tasks.clone().map(|task| task.word_count() as u64).sum();
    let shape = MaskShape::sparse(budget.n(), word_count, word_count, budget.with_order());
    let out = reply.reserve(shape.extent_words())?;
    let stride = word_count.next_multiple_of(SECTION_ALIGN_WORDS) as usize;
    let (rows, rest) = out.split_at_mut(stride);
    let (blocks, rest) = rest.split_at_mut(stride);
    // Without an order the reply may end with the last word.
    let (bits, rest) = rest.split_at_mut(stride.min(rest.len()));
    let mut jobs = [
        (Section::Words(0), rows),
        (Section::Words(1), blocks),
        (Section::Words(2), bits),
        (Section::Order, &mut rest[..order.len()]),
    ];
    let parallel = parallel && word_count as usize + order.len() >= PARALLEL_WORDS;
    let parts = if parallel { jobs.len() } else { 1 };
    for_each_in_parts(&mut jobs, parts, |(section, out)| match section {
        Section::Words(array) => copy_words(tasks.clone(), *array, out, budget.cancel()),
        Section::Order => out.copy_from_slice(order),
    });
    Ok(shape)
}

enum Section {
    /// One of the three arrays of words.
    Words(usize),
    Order,
}

/// One of the three arrays of all tasks' words.
fn copy_words<'a, W: FoundWords + 'a>(
    tasks: impl Iterator<Item = &'a W>,
    array: usize,
    out: &mut [u32],
    cancel: &Cancel,
) {
    let (mut rest, mut pace) = (out, Pace::default());
    for words in tasks.flat_map(FoundWords::chunks).map(|arrays| arrays[array]) {
        if cancel.look_after(WORD_TESTS * words.len() as u64, &mut pace) {
            return;
        }
        let (here, later) = rest.split_at_mut(words.len());
        here.copy_from_slice(words);
        rest = later;
    }
}
