//! Rules over a mask that an engine without rules has written: that of a GPU.

use std::ops::Range;

use super::laid::Laid;
use super::look::Look;
use super::sets::SetsTest;
use super::test::{FilterTest, Indices};
use crate::engine::{CullReport, PairTest};
use crate::filters::Rules;
use crate::mask::{MaskShape, Span};
use crate::pair_index::row_start;
use crate::team::{self, for_each_in_parts, in_parts, part_count};
use crate::units::{BoxCount, PairIndex};

/// Words of a mask, or pairs of a list, of a task, at least: some 20 µs.
const TASK_ENTRIES: usize = 4_096;
const BLOCK: u32 = 32;

/// Takes the pairs out of masks that rules part, in place. What it allocates is kept for the next.
#[derive(Debug, Default)]
pub struct MaskFilter {
    laid: Laid,
    sets: Vec<u32>,
    order: Vec<u32>,
}

/// A mask that cannot be filtered: its sections are not where its shape says, or its order names no boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the mask of an engine is malformed")]
pub struct BadMask;

impl MaskFilter {
    /// Takes the pairs of `n` boxes that `rules` part out of a mask in `reply`, which `report` describes,
    /// and changes the report with it. So many threads of the calling thread's pool may take part.
    ///
    /// # Errors
    /// [`BadMask`]. What is left in the reply is unspecified then.
    pub fn filter(
        &mut self,
        rules: &Rules,
        n: BoxCount,
        reply: &mut [u32],
        report: &mut CullReport,
        threads: usize,
    ) -> Result<(), BadMask> {
        let look = Look::at(rules, n.len());
        if look.all_meet {
            return Ok(());
        }
        self.take_order(n, &report.shape, reply)?;
        let test = FilterTest::new(rules, &look, Indices::Same, std::mem::take(&mut self.laid));
        let done = self.test_all(&test, n, reply, report, threads);
        self.laid = test.into_memory();
        done
    }

    /// The same with two sets: only the pairs of a box of the first `first` and one of the others stay.
    ///
    /// # Errors
    /// As [`filter`](Self::filter).
    pub fn filter_sets(
        &mut self,
        first: BoxCount,
        n: BoxCount,
        reply: &mut [u32],
        report: &mut CullReport,
        threads: usize,
    ) -> Result<(), BadMask> {
        self.take_order(n, &report.shape, reply)?;
        let test = SetsTest::new(first, std::mem::take(&mut self.sets));
        let done = self.test_all(&test, n, reply, report, threads);
        self.sets = test.into_memory();
        done
    }

    /// Takes pairs out that do not pass a test.
    fn test_all(
        &self,
        test: &dyn PairTest,
        n: BoxCount,
        reply: &mut [u32],
        report: &mut CullReport,
        threads: usize,
    ) -> Result<(), BadMask> {
        let _team = team::enter(threads);
        test.prepare(n.len(), &self.order, threads);
        let masked = Masked { test, n: n.get(), order: &self.order };
        let done = match &mut report.shape {
            MaskShape::Dense { words } => {
                section(reply, words).map(|words| masked.dense(n, words, threads))
            }
            MaskShape::Sparse { rows, blocks, bits, .. } => sections(reply, [rows, blocks, bits])
                .map(|words| {
                    let (kept, pairs) = masked.sparse(words, threads);
                    (rows.len, blocks.len, bits.len) = (kept, kept, kept);
                    pairs
                }),
            MaskShape::List { pairs: span } => section(reply, span).map(|words| {
                let pairs = masked.list(words.as_chunks_mut().0, threads);
                span.len = 2 * pairs;
                pairs
            }),
        };
        report.pair_count = done.ok_or(BadMask)?;
        report.skipped.zero_words = report.shape.zero_words(n);
        Ok(())
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.laid.allocated_bytes()
            + (self.sets.capacity() + self.order.capacity()) * size_of::<u32>()
    }

    /// Copies the order of a mask, if it has one: the memory of a reply is not this process's alone.
    fn take_order(&mut self, n: BoxCount, shape: &MaskShape, reply: &[u32]) -> Result<(), BadMask> {
        self.order.clear();
        let MaskShape::Sparse { order: Some(order), .. } = shape else {
            return Ok(());
        };
        self.order.extend_from_slice(order.of(reply).ok_or(BadMask)?);
        let is_right =
            self.order.len() == n.len() && self.order.iter().all(|index| *index < n.get());
        if is_right { Ok(()) } else { Err(BadMask) }
    }
}

/// The words of a section, to be changed.
fn section<'a>(reply: &'a mut [u32], span: &Span) -> Option<&'a mut [u32]> {
    reply.get_mut(range_of(span)?)
}

fn range_of(span: &Span) -> Option<Range<usize>> {
    let start = usize::try_from(span.start).ok()?;
    Some(start..start.checked_add(usize::try_from(span.len).ok()?)?)
}

/// Three sections as long as each other, one behind the other.
fn sections<'a>(reply: &'a mut [u32], spans: [&Span; 3]) -> Option<[&'a mut [u32]; 3]> {
    let [one, two, three] = [range_of(spans[0])?, range_of(spans[1])?, range_of(spans[2])?];
    let is_right = one.end <= two.start
        && two.end <= three.start
        && three.end <= reply.len()
        && (one.len(), one.len()) == (two.len(), three.len());
    if !is_right {
        return None;
    }
    let (low, rest) = reply.split_at_mut(two.start);
    let (middle, high) = rest.split_at_mut(three.start - two.start);
    Some([&mut low[one], &mut middle[..two.len()], &mut high[..three.len()]])
}

/// A test of the words of a mask. Words that name no boxes are empty.
struct Masked<'a> {
    test: &'a dyn PairTest,
    n: u32,
    order: &'a [u32],
}

/// Items of a part of a mask, and how many of them are kept, at its beginning.
struct Part<T> {
    entries: T,
    kept: usize,
    pairs: u64,
}

impl Masked<'_> {
    /// The bits of a word whose boxes meet.
    fn passing(&self, row: u32, block: u32, bits: u32) -> u32 {
        let first = u64::from(block) * u64::from(BLOCK);
        let columns = u64::from(self.n).saturating_sub(first).min(u64::from(BLOCK));
        let there = bits & ((1u64 << columns) - 1) as u32;
        if row >= self.n || there == 0 {
            return 0;
        }
        there & self.test.passing(row, block, there, self.order)
    }

    /// Clears bits of a dense mask. Returns the pairs that are left.
    fn dense(&self, n: BoxCount, words: &mut [u32], threads: usize) -> u64 {
        let parts = part_count(words.len(), TASK_ENTRIES, threads);
        let step = words.len().div_ceil(parts).max(1);
        let mut work: Vec<(usize, &mut [u32])> =
            words.chunks_mut(step).enumerate().map(|(at, words)| (at * step, words)).collect();
        let run = |work: &mut [(usize, &mut [u32])]| {
            work.iter_mut().map(|(first, words)| self.dense_part(n, *first as u64, words)).sum()
        };
        in_parts(work.as_mut_slice(), parts, &run, &|a: u64, b: u64| a + b)
    }

    /// Clears bits of the words of a dense mask from a word on.
    fn dense_part(&self, n: BoxCount, first: u64, words: &mut [u32]) -> u64 {
        let Some([mut row, _]) = PairIndex::new(32 * first).pair(n) else {
            words.fill(0);
            return 0;
        };
        let mut start = row_start(n, row);
        let mut pairs = 0;
        for (at, word) in (first..).zip(words) {
            let (mut passing, mut rest) = (0, *word);
            while rest != 0 {
                let bit = rest.trailing_zeros();
                let k = 32 * at + u64::from(bit);
                if k >= n.pair_count() {
                    break;
                }
                let mut end = start + u64::from(self.n - 1 - row);
                while k >= end {
                    (start, row) = (end, row + 1);
                    end = start + u64::from(self.n - 1 - row);
                }
                // The bits of this row as far as the block of the first one's column goes.
                let column = row + 1 + (k - start) as u32;
                let in_block = BLOCK - column % BLOCK;
                let count = u64::from(in_block).min(end - k).min(u64::from(32 - bit));
                let these = (rest >> bit) & ((1u64 << count) - 1) as u32;
                let shift = column % BLOCK;
                passing |= (self.passing(row, column / BLOCK, these << shift) >> shift) << bit;
                rest &= !(these << bit);
            }
            *word = passing;
            pairs += u64::from(passing.count_ones());
        }
        pairs
    }

    /// Clears bits of a sparse mask, and takes words out that have none left. Returns how many words and
    /// pairs are left.
    fn sparse(&self, [rows, blocks, bits]: [&mut [u32]; 3], threads: usize) -> (u64, u64) {
        let parts = part_count(rows.len(), TASK_ENTRIES, threads);
        let step = rows.len().div_ceil(parts).max(1);
        let chunks = blocks.chunks_mut(step).zip(bits.chunks_mut(step));
        let chunks = rows.chunks_mut(step).zip(chunks);
        let part =
            |(rows, (blocks, bits))| Part { entries: [rows, blocks, bits], kept: 0, pairs: 0 };
        let mut work: Vec<Part<[&mut [u32]; 3]>> = chunks.map(part).collect();
        for_each_in_parts(
            &mut work,
            parts,
            |Part { entries: [rows, blocks, bits], kept, pairs }| {
                for at in 0..rows.len() {
                    let (row, block) = (rows[at], blocks[at]);
                    let left = self.passing(row, block, bits[at]);
                    (rows[*kept], blocks[*kept], bits[*kept]) = (row, block, left);
                    *kept += usize::from(left != 0);
                    *pairs += u64::from(left.count_ones());
                }
            },
        );
        let pairs = work.iter().map(|part| part.pairs).sum();
        let kept: Vec<usize> = work.iter().map(|part| part.kept).collect();
        drop(work);
        for words in [rows, blocks, bits] {
            close_gaps(words, step, &kept);
        }
        (kept.iter().sum::<usize>() as u64, pairs)
    }

    /// Takes pairs out of a list. Returns how many are left.
    fn list(&self, pairs: &mut [[u32; 2]], threads: usize) -> u64 {
        let parts = part_count(pairs.len(), TASK_ENTRIES, threads);
        let step = pairs.len().div_ceil(parts).max(1);
        let part = |entries| Part { entries, kept: 0, pairs: 0 };
        let mut work: Vec<Part<&mut [[u32; 2]]>> = pairs.chunks_mut(step).map(part).collect();
        for_each_in_parts(&mut work, parts, |Part { entries, kept, .. }| {
            for at in 0..entries.len() {
                let [a, b] = entries[at];
                entries[*kept] = [a, b];
                *kept += usize::from(self.passing(a, b / BLOCK, 1 << (b % BLOCK)) != 0);
            }
        });
        let kept: Vec<usize> = work.iter().map(|part| part.kept).collect();
        drop(work);
        close_gaps(pairs, step, &kept);
        kept.iter().sum::<usize>() as u64
    }
}

/// Moves the items that each chunk has kept, at its beginning, behind those of the chunk before.
fn close_gaps<T: Copy>(entries: &mut [T], step: usize, kept: &[usize]) {
    let mut end = 0;
    for (chunk, kept) in kept.iter().enumerate() {
        let first = chunk * step;
        if first != end {
            entries.copy_within(first..first + kept, end);
        }
        end += kept;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{KINDS, Random, rules};
    use super::*;
    use crate::dispatch::{CpuEngines, CullOptions};
    use crate::engine::HeapReply;
    use crate::mask::MaskView;

    #[test]
    fn a_mask_of_any_words_is_filtered_or_refused() {
        let mut random = Random(75);
        let n = 100;
        let mut rules = rules(&mut random, n, KINDS[3]);
        rules.lists.exclude([3, 5], true);
        let count = BoxCount::new(n as u32);
        let mut filter = MaskFilter::default();
        let mut reply = HeapReply::new();
        let boxes = random.boxes(n);
        let report = CpuEngines::new().cull(&boxes, &CullOptions::default(), &mut reply);
        let report = report.expect("an answer").report;
        for round in 0..2_000 {
            let mut words: Vec<u32> = (0..1_000)
                .map(|_| {
                    let width = 1 + random.below(32);
                    random.below(1 << width) as u32
                })
                .collect();
            if round % 3 == 0 {
                for word in &mut words {
                    *word %= 128;
                }
            }
            let span = |random: &mut Random, len| Span { start: random.below(400), len };
            let (len, more) = (random.below(60), random.below(2));
            let shape = match round % 4 {
                0 => MaskShape::dense(count),
                1 => MaskShape::list(random.below(700)),
                2 => MaskShape::sparse(count, len + random.below(40), len, random.below(2) == 0),
                _ => MaskShape::Sparse {
                    rows: span(&mut random, len),
                    blocks: span(&mut random, len),
                    bits: span(&mut random, len + more),
                    order: Some(span(&mut random, n as u64)),
                },
            };
            let mut report = CullReport { shape, ..report };
            if filter.filter(&rules, count, &mut words, &mut report, 1).is_ok() {
                let mask = MaskView::new(count, &report.shape, &words).expect("a mask");
                let met = |[a, b]: [u32; 2]| rules.meet(a, b);
                assert!(mask.pairs().all(met), "{shape:?}");
            }
        }
    }
}
