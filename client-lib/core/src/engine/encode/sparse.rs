//! The sparse encoding: the words of all tasks behind one another, in three arrays, and the order.

use super::{EncodingCost, FoundWords};
use crate::engine::cost::terms;
use crate::engine::gather::Gather;
use crate::engine::strips::in_parts;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::{MaskShape, SECTION_ALIGN_WORDS};
use crate::stats::SceneStats;

terms! {
    /// A pair of boxes in their own order: kept, published, decoded.
    PAIR = CostTerm::new("sparse-pair", 1.01);
    /// More for a pair in an order of the engine's. Without the decoder by words, which needs
    /// AVX-512 VBMI2, it was measured before there was one.
    ORDERED_PAIR = CostTerm::avx512_or("ordered-pair", 0.0971, 0.77);
}

/// What sparse masks take.
pub(super) const COST: EncodingCost = EncodingCost { terms: TERMS, work };

fn work(stats: &SceneStats, has_order: bool, amounts: &mut [f64]) {
    let pairs = stats.expected_pairs();
    amounts[PAIR] = pairs;
    amounts[ORDERED_PAIR] = if has_order { pairs } else { 0.0 };
}

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
    let write = |jobs: &mut [(Section, &mut [u32])]| {
        for (section, out) in jobs {
            match section {
                Section::Words(array) => copy_words(tasks.clone(), *array, out),
                Section::Order => out.copy_from_slice(order),
            }
        }
    };
    let parallel = parallel && word_count as usize + order.len() >= PARALLEL_WORDS;
    let parts = if parallel { jobs.len() } else { 1 };
    in_parts(jobs.as_mut_slice(), parts, &write, &|(), ()| ());
    Ok(shape)
}

/// A section of the reply.
enum Section {
    /// One of the three arrays of words.
    Words(usize),
    /// The order of the boxes.
    Order,
}

/// One of the three arrays of all tasks' words.
fn copy_words<'a, W: FoundWords + 'a>(
    tasks: impl Iterator<Item = &'a W>,
    array: usize,
    out: &mut [u32],
) {
    let mut rest = out;
    for words in tasks.flat_map(FoundWords::chunks).map(|arrays| arrays[array]) {
        let (here, later) = rest.split_at_mut(words.len());
        here.copy_from_slice(words);
        rest = later;
    }
}
