//! Frames of two sets: of the pairs of the whole frame, those of a box of one set and a box of the other.

use super::laid::BLOCK;
use crate::dispatch::{CpuEngines, CullAnswer, CullOptions};
use crate::engine::word_budget::WordBudget;
use crate::engine::{CullError, PairRules, PairTest, Prepared, ReplyBuffer, counted};
use crate::precision::BoxSlice;
use crate::team::zip_in_parts;
use crate::units::BoxCount;

/// Blocks of a task that lays the sets out, at least: some 10 µs.
const TASK_BLOCKS: usize = 256;

/// The first boxes of a frame against all others, as a test that engines hand their words to.
pub struct SetsTest {
    first: u32,
    /// A bit for each position of the engine's order, once it has said it: whether the box there is of the
    /// first set.
    laid: Prepared<Vec<u32>>,
}

impl SetsTest {
    /// The test of a frame whose first `first` boxes are a set. `memory` is what an earlier test gave back.
    pub const fn new(first: BoxCount, memory: Vec<u32>) -> Self {
        Self { first: first.get(), laid: Prepared::new(memory) }
    }

    /// Gives the memory back for the next frame.
    pub fn into_memory(self) -> Vec<u32> {
        self.laid.into_memory()
    }

    /// Whether the box at a position is of the first set.
    fn is_first(&self, at: u32, order: &[u32]) -> bool {
        order.get(at as usize).map_or(at, |index| *index) < self.first
    }

    /// The columns of a block whose boxes are of the first set, where positions are indices.
    fn columns_below(&self, block: u32) -> u32 {
        let first = u64::from(block) * BLOCK as u64;
        let count = u64::from(self.first).saturating_sub(first).min(BLOCK as u64);
        ((1u64 << count) - 1) as u32
    }
}

fn bit(word: u32, at: u32) -> bool {
    word >> (at % BLOCK as u32) & 1 != 0
}

impl PairTest for SetsTest {
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let (is_first, columns) = if let Some(laid) = self.laid.get() {
            let word = |block: u32| laid.get(block as usize).copied().unwrap_or(0);
            (bit(word(row / BLOCK as u32), row), word(block))
        } else if order.is_empty() {
            (row < self.first, self.columns_below(block))
        } else {
            let (mut columns, mut rest) = (0, bits);
            while rest != 0 {
                let column = rest.trailing_zeros();
                let at = block.wrapping_mul(BLOCK as u32).wrapping_add(column);
                columns |= u32::from(self.is_first(at, order)) << column;
                rest &= rest - 1;
            }
            (self.is_first(row, order), columns)
        };
        bits & if is_first { !columns } else { columns }
    }

    fn prepare(&self, count: usize, order: &[u32], threads: usize) {
        if order.is_empty() {
            return;
        }
        let blocks: Vec<&[u32]> = order[..count.min(order.len())].chunks(BLOCK).collect();
        self.laid.prepare(|laid| {
            laid.resize(count.div_ceil(BLOCK), 0);
            zip_in_parts(laid, &blocks, TASK_BLOCKS, threads, |words, blocks| {
                for (word, some) in words.iter_mut().zip(blocks) {
                    *word = (0..)
                        .zip(*some)
                        .fold(0, |word, (bit, index)| word | u32::from(*index < self.first) << bit);
                }
            });
            true
        });
    }
}

impl CpuEngines {
    /// Plans a frame of two sets among the CPU engines, and finds the pairs of a box of the first `first` and
    /// one of the others, by way of all pairs of the frame: in little more than its time, however large the
    /// sets are. Where one is small, to look for its boxes in the other one is sooner done.
    ///
    /// # Errors
    /// As [`cull`](Self::cull). Boxes have to be in f32.
    pub fn cull_sets<'a>(
        &mut self,
        boxes: impl Into<BoxSlice<'a>>,
        first: BoxCount,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let boxes = boxes.into();
        self.cull_by(boxes, options, reply, |engines, plan, reply| {
            if let Some(f32_boxes) = boxes.as_f32() {
                let n = counted(f32_boxes, plan.engine)?;
                let budget = WordBudget::new(n, plan.encoding, false, reply)?;
                let first = first.len().min(f32_boxes.len());
                budget.look_at(|index| f32_boxes.get(index).copied(), Some(first))?;
            }
            let test = SetsTest::new(first, Vec::new());
            let input = plan.input(boxes).rules(PairRules::tested_by(&test));
            engines.run(plan.engine, &input, reply)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::MaskFilter;
    use super::super::tests::{Random, in_pool};
    use super::*;
    use crate::aabb::Aabb;
    use crate::engine::{EngineChoice, EngineName, HeapReply};
    use crate::mask::{Encoding, EncodingChoice, MaskView};
    use crate::oracle;

    fn truth(boxes: &[Aabb], first: usize) -> Vec<[u32; 2]> {
        let mut pairs = oracle::truth(boxes).pairs;
        pairs.retain(|[a, b]| (*a as usize) < first && first <= *b as usize);
        pairs
    }

    fn pairs_of(n: BoxCount, report: &crate::engine::CullReport, words: &[u32]) -> Vec<[u32; 2]> {
        let mask = MaskView::new(n, &report.shape, words).expect("a mask");
        mask.verify().expect("in order");
        let mut pairs = mask.to_vec();
        assert_eq!(pairs.len() as u64, report.pair_count);
        pairs.sort_unstable();
        pairs
    }

    /// Two sets culled by each engine, in each encoding, and taken out of the mask of the whole frame.
    fn check(random: &mut Random, n: usize, threads: usize) {
        let boxes = random.boxes(n);
        let count = BoxCount::new(n as u32);
        let (mut engines, mut filter) = (CpuEngines::new(), MaskFilter::default());
        for first in [0, 1, n / 3, n / 2, n] {
            let first = first.min(n);
            let expected = truth(&boxes, first);
            let set = BoxCount::new(first as u32);
            for engine in EngineName::CPU {
                for encoding in Encoding::ALL {
                    let options = CullOptions {
                        engine: EngineChoice::Only(engine),
                        encoding: EncodingChoice::Only(encoding),
                        threads: Some(threads),
                        ..CullOptions::default()
                    };
                    let mut reply = HeapReply::new();
                    let answer = engines.cull_sets(&boxes, set, &options, &mut reply);
                    let report = answer.expect("an answer").report;
                    let found = pairs_of(count, &report, reply.words());
                    assert_eq!(found, expected, "{first} of {n}, {engine} {encoding}");

                    let whole = engines.cull(&boxes, &options, &mut reply);
                    let mut report = whole.expect("an answer").report;
                    let mut words = reply.words().to_vec();
                    let done = filter.filter_sets(set, count, &mut words, &mut report, threads);
                    done.expect("as it was written");
                    let found = pairs_of(count, &report, &words);
                    assert_eq!(found, expected, "{first} of {n}, {engine} {encoding}, filtered");
                }
            }
        }
    }

    #[test]
    fn frames_of_two_sets_have_the_pairs_between_them() {
        let mut random = Random(171);
        for n in 0..=70 {
            check(&mut random, n, 1);
        }
        for threads in 1..=3 {
            in_pool(threads, || {
                let mut random = Random(173);
                for n in [345, 4_097, 9_001] {
                    check(&mut random, n, threads);
                }
            });
        }
    }
}
