//! The list encoding: the pairs of boxes themselves, in the order of the words of all tasks.

use super::{EncodingCost, FoundWords};
use crate::cancel::Pace;
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::MaskShape;
use crate::stats::SceneStats;
use crate::team::{Split, in_parts};

/// What lists take.
pub(super) const COST: EncodingCost = EncodingCost {
    write: &[
        CostTerm::new(70.2, |_, _| 1.0),
        // A pair of boxes in their own order: kept, and written.
        CostTerm::new(1.26, |stats, _| stats.expected_pairs()),
        // More for a pair in an order of the engine's, of which two boxes are looked up.
        CostTerm::avx512_or(0.102, 0.7, SceneStats::ordered_pairs),
    ],
    iterate: &[
        CostTerm::new(87.3, |_, _| 1.0),
        CostTerm::by_lanes(0.365, |stats, _| stats.expected_pairs()),
    ],
    bytes: |stats, _| PAIR_BYTES * stats.expected_pairs(),
};

const PAIR_BYTES: f64 = 8.0;

/// A word whose pairs are named, in tests of boxes.
const WORD_TESTS: u64 = 32;

/// Fewest pairs that are worth a second thread: some 10 µs of work.
const PARALLEL_PAIRS: u64 = 8 * 1024;

/// Writes the pairs of the words of all tasks and says where they lie.
///
/// Each task knows its number of pairs, so that each has its place before any is written: the bytes do
/// not depend on which thread writes them.
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
    let pair_count = tasks.clone().map(FoundWords::pair_count).sum();
    let shape = MaskShape::list(pair_count);
    let (out, _) = reply.reserve(shape.extent_words())?.as_chunks_mut();
    let task_count = tasks.clone().count();
    let all = Part { tasks, first: 0, task_count, out: &mut out[..pair_count as usize] };
    let parts = if parallel && pair_count >= PARALLEL_PAIRS { task_count } else { 1 };
    in_parts(all, parts, &|part: Part<'_, T>| part.write(gather), &|(), ()| ());
    Ok(shape)
}

/// Some tasks in sequence, and the room for exactly their pairs.
struct Part<'a, T> {
    tasks: &'a T,
    first: usize,
    task_count: usize,
    out: &'a mut [[u32; 2]],
}

impl<'a, W, T> Part<'_, T>
where
    W: FoundWords + 'a,
    T: Iterator<Item = &'a W> + Clone,
{
    fn tasks(&self, from: usize, count: usize) -> impl Iterator<Item = &'a W> + use<'a, W, T> {
        self.tasks.clone().skip(self.first + from).take(count)
    }

    fn write(self, gather: &Gather<'_>) {
        let tasks = self.tasks(0, self.task_count);
        let (mut rest, mut pace) = (self.out, Pace::default());
        for words in tasks.flat_map(FoundWords::chunks) {
            if gather.budget.cancel().look_after(WORD_TESTS * words[2].len() as u64, &mut pace) {
                return;
            }
            gather.name_pairs(words, |pairs| {
                let (here, later) = std::mem::take(&mut rest).split_at_mut(pairs.len());
                here.copy_from_slice(pairs);
                rest = later;
            });
        }
        debug_assert!(rest.is_empty(), "a task's count of pairs is that of its words' bits");
    }
}

impl<'a, W, T> Split for Part<'_, T>
where
    W: FoundWords + 'a,
    T: Iterator<Item = &'a W> + Clone + Send + Sync,
{
    fn len(&self) -> usize {
        self.task_count
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let pairs: u64 = self.tasks(0, at).map(FoundWords::pair_count).sum();
        let (low, high) = self.out.split_at_mut(pairs as usize);
        let Self { tasks, first, task_count, .. } = self;
        (
            Self { tasks, first, task_count: at, out: low },
            Self { tasks, first: first + at, task_count: task_count - at, out: high },
        )
    }
}
