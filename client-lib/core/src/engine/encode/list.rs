//! The list encoding: the pairs of boxes themselves, in the order of the words of all tasks.

use super::{EncodingCost, FoundWords, MaskWork};
use crate::engine::cost::terms;
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::MaskShape;
use crate::stats::SceneStats;
use crate::team::{Split, in_parts};

terms! {
    LIST = CostTerm::new("list", 70.2);
    /// A pair of boxes in their own order: kept, and written.
    PAIR = CostTerm::new("list-pair", 1.26);
    /// More for a pair in an order of the engine's, of which two boxes are looked up.
    ORDERED_PAIR = CostTerm::avx512_or("list-ordered-pair", 0.102, 0.7);
}

/// What lists take.
pub(super) const COST: EncodingCost = EncodingCost {
    write: MaskWork { terms: TERMS, amounts },
    visit: MaskWork { terms: visit::TERMS, amounts: visit::amounts },
    bytes: |stats, _| PAIR_BYTES * stats.expected_pairs(),
};

const PAIR_BYTES: f64 = 8.0;

fn amounts(stats: &SceneStats, has_order: bool, amounts: &mut [f64]) {
    let pairs = stats.expected_pairs();
    amounts[LIST] = 1.0;
    amounts[PAIR] = pairs;
    amounts[ORDERED_PAIR] = if has_order { pairs } else { 0.0 };
}

/// What the client does.
mod visit {
    use super::{CostTerm, SceneStats, terms};

    terms! {
        LIST = CostTerm::new("list-visit", 87.3);
        PAIR = CostTerm::by_lanes("list-visit-pair", 0.365);
    }

    pub(super) fn amounts(stats: &SceneStats, _: bool, amounts: &mut [f64]) {
        amounts[LIST] = 1.0;
        amounts[PAIR] = stats.expected_pairs();
    }
}

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
        let mut rest = self.out;
        for words in tasks.flat_map(FoundWords::chunks) {
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

#[cfg(test)]
mod tests {
    use crate::Aabb;
    use crate::engine::{CullInput, EngineName, HeapReply, Isa, ReplyBuffer, cpu_engine};
    use crate::mask::Encoding;

    #[test]
    fn a_list_that_does_not_fit_is_refused() {
        let boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 40];
        for name in EngineName::CPU {
            let mut engine = cpu_engine(name, Isa::best()).expect("of the CPU");
            let mut reply = HeapReply::with_limit_bytes(8 * 779);
            assert!(reply.limit_words() == 2 * 779);
            let input = CullInput::boxes(&boxes).encoding(Encoding::List);
            assert!(engine.cull(&input, &mut reply).is_err(), "{name}: 780 pairs");
        }
    }
}
