//! Blocks: up to 16 consecutive rows against the strips that they share.
//!
//! Rows that follow each other in a line of cells look at nearly the same columns. A block cuts those
//! into strips once, and the columns of a strip are loaded once for all of its rows. Both lie on
//! 16-borders of the positions, so that a strip is one half of a mask word and nothing has to be
//! shifted from one word into the next.

use std::ops::Range;

#[cfg(target_arch = "x86_64")]
use super::block_avx512;
use super::ordered::{KeyArrays, OrderedBoxes};
use super::sink::WordChunk;
use super::{STRIP_COLUMNS, batch};
use crate::engine::{AvailableIsa, Isa};

/// Most rows of a block, and most strips: the lanes of a register, and columns of a strip.
pub(crate) const BLOCK_LANES: usize = STRIP_COLUMNS;

/// Strips that are written at a time, wanted or not.
const AT_A_TIME: usize = 4;

/// Room for those behind the last one that were not wanted.
const ALLOCATED: usize = BLOCK_LANES + AT_A_TIME;

/// Some rows of a block: bit i is its row i.
pub(crate) type RowSet = u16;

/// Consecutive rows, the strips that they are tested against, and what was found.
#[derive(Default)]
pub(crate) struct RowBlock {
    pub(super) first_row: u32,
    /// At most [`BLOCK_LANES`], all before the next multiple of it.
    pub(super) row_count: usize,
    /// First column of each strip, a multiple of 16; they rise.
    pub(super) starts: [u32; ALLOCATED],
    /// Columns of each strip that belong to a run.
    pub(super) lanes: [u16; ALLOCATED],
    /// Rows that look at each strip.
    pub(super) rows: [RowSet; ALLOCATED],
    /// At most [`BLOCK_LANES`].
    pub(super) strip_count: usize,
    /// After the test: the columns of each strip that each row overlaps. Rows first.
    pub(super) overlaps: [[u16; BLOCK_LANES]; BLOCK_LANES],
}

impl RowBlock {
    /// Whether blocks take less time than each row by itself. So it is with AVX-512; with half as many
    /// lanes, the columns that a row tests in vain take longer than blocks save.
    pub fn pays(isa: AvailableIsa) -> bool {
        isa.get() == Isa::Avx512
    }

    /// Where the block that begins at `first_row` has to end.
    pub fn border(first_row: u32) -> u32 {
        (first_row / BLOCK_LANES as u32 + 1).saturating_mul(BLOCK_LANES as u32)
    }

    /// Begins the block of `rows`, which end at the [`Self::border`] or before, and look at all
    /// positions after themselves up to `own_end`. `false` when these are too many strips.
    #[inline(always)]
    pub fn begin(&mut self, rows: Range<u32>, own_end: u32) -> bool {
        debug_assert!(rows.start < rows.end && rows.end <= Self::border(rows.start));
        self.first_row = rows.start;
        self.row_count = ((rows.end - rows.start) as usize).min(BLOCK_LANES);
        self.strip_count = 0;
        self.add(rows.start + 1..own_end, self.all_rows())
    }

    #[inline(always)]
    pub fn all_rows(&self) -> RowSet {
        RowSet::MAX >> (BLOCK_LANES - self.row_count)
    }

    /// Adds columns that `rows` look at: a run after all rows, and after the runs before. `false` when
    /// these are too many strips.
    ///
    /// Where two runs meet in a strip, the rows of both look at both, which finds nothing new.
    #[inline(always)]
    pub fn add(&mut self, columns: Range<u32>, rows: RowSet) -> bool {
        if rows == 0 || columns.start >= columns.end {
            return true;
        }
        let width = STRIP_COLUMNS as u32;
        let first = columns.start / width * width;
        let count = (columns.end - first).div_ceil(width) as usize;
        let last = self.strip_count.saturating_sub(1);
        let meets = self.strip_count > 0 && self.starts[last] == first;
        let at = self.strip_count - usize::from(meets);
        if at + count > BLOCK_LANES {
            return false;
        }
        let before = if meets { (self.lanes[last], self.rows[last]) } else { (0, 0) };
        // Most runs have no more, and how many they have is hard to predict.
        for k in (0..count).step_by(AT_A_TIME) {
            for i in k..k + AT_A_TIME {
                self.starts[at + i] = first + width * i as u32;
                self.lanes[at + i] = u16::MAX;
                self.rows[at + i] = rows;
            }
        }
        self.lanes[at + count - 1] = u16::MAX >> (width - 1 - (columns.end - 1) % width);
        self.lanes[at] = self.lanes[at] & u16::MAX << (columns.start % width) | before.0;
        self.rows[at] |= before.1;
        self.strip_count = at + count;
        true
    }

    /// Tests the rows against their strips; returns the columns compared.
    ///
    /// # Panics
    /// When a row or a strip is none of the boxes.
    pub fn test(&mut self, boxes: &OrderedBoxes, isa: AvailableIsa) -> u64 {
        let keys = boxes.keys();
        match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => block_avx512::test(&keys, self, isa),
            _ => self.test_strips(&keys, isa),
        }
    }

    fn test_strips(&mut self, keys: &KeyArrays<'_>, isa: AvailableIsa) -> u64 {
        self.overlaps = Default::default();
        let mut compared = 0;
        for i in 0..self.row_count {
            for strip in (0..self.strip_count).filter(|s| self.rows[*s] >> i & 1 != 0) {
                let lanes = self.lanes[strip] & self.columns_after(i, strip);
                let row = [self.first_row + i as u32];
                let mut overlaps = [lanes];
                compared += batch::test(keys, &row, &[self.starts[strip]], &mut overlaps, isa);
                self.overlaps[i][strip] = overlaps[0];
            }
        }
        compared
    }

    fn columns_after(&self, row: usize, strip: usize) -> u16 {
        let next = self.first_row + row as u32 + 1;
        let before = next.saturating_sub(self.starts[strip]).min(STRIP_COLUMNS as u32);
        (u32::from(u16::MAX) << before) as u16
    }

    /// Adds the words of rows from `from` on while the chunk has room; returns the next row, and the
    /// pairs that were added.
    pub(super) fn append(
        &self,
        from: usize,
        chunk: &mut WordChunk,
        isa: AvailableIsa,
    ) -> (usize, u64) {
        match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => block_avx512::append(self, from, chunk, isa),
            _ => self.append_portable(from, chunk),
        }
    }

    fn append_portable(&self, from: usize, chunk: &mut WordChunk) -> (usize, u64) {
        let (mut row, mut pairs) = (from, 0);
        while row < self.row_count && chunk.has_room() {
            for (&overlaps, &start) in self.overlaps[row].iter().zip(&self.starts) {
                let bits = u32::from(overlaps) << (start % 32);
                chunk.push(self.first_row + row as u32, start / 32, bits);
                pairs += u64::from(bits.count_ones());
            }
            row += 1;
        }
        (row, pairs)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::super::WordSink;
    use super::*;
    use crate::engine::encode::FoundWords;
    use crate::engine::gather::Gather;
    use crate::engine::word_budget::WordBudget;
    use crate::engine::{HeapReply, PairRules};
    use crate::mask::Encoding;
    use crate::units::BoxCount;

    const N: usize = 345;

    /// Boxes of which about every second two overlap.
    fn boxes() -> OrderedBoxes {
        let mut boxes = OrderedBoxes::default();
        boxes.resize(N);
        let (keys, order) = boxes.parts_mut();
        for (i, index) in (0u32..).zip(order) {
            *index = i;
        }
        for (component, array) in (0u32..).zip(keys) {
            for (i, key) in (0u32..).zip(array) {
                let place = (6 * i + component % 3).wrapping_mul(0x9e37_79b9) >> 25;
                *key = place as i32 + if component < 3 { 0 } else { 90 };
            }
        }
        boxes
    }

    /// A block: first row and rows, columns of its own run behind the rows, and gap, columns and rows of
    /// the others.
    type Case = (u32, u32, u32, Vec<(u32, u32, RowSet)>);

    fn case() -> impl Strategy<Value = Case> {
        let run = (0u32..40, 0u32..40, any::<RowSet>());
        (0u32..150, 1u32..17, 0u32..40, prop::collection::vec(run, 0..6))
    }

    /// The block, as far as there is room, and the pairs of positions that it has to test.
    fn block((first, count, own, runs): &Case) -> Option<(RowBlock, BTreeSet<(u32, u32)>)> {
        let rows = *first..(first + count).min(RowBlock::border(*first));
        let mut tested = BTreeSet::new();
        let mut add = |rows: Range<u32>, set: RowSet, columns: Range<u32>| {
            for (i, row) in rows.enumerate().filter(|(i, _)| set >> i & 1 != 0) {
                debug_assert!(i < BLOCK_LANES);
                tested.extend(columns.clone().filter(|c| *c > row).map(|column| (row, column)));
            }
        };
        let mut block = RowBlock::default();
        let mut end = rows.end + own;
        let mut fits = block.begin(rows.clone(), end);
        add(rows.clone(), RowSet::MAX, rows.start + 1..end);
        for &(gap, len, set) in runs {
            let columns = end + gap..(end + gap + len).min(N as u32);
            if columns.start < columns.end {
                fits &= block.add(columns.clone(), set & block.all_rows());
                add(rows.clone(), set, columns.clone());
                end = columns.end;
            }
        }
        fits.then_some((block, tested))
    }

    proptest! {
        #[test]
        fn every_instruction_set_finds_what_a_block_overlaps(case in case()) {
            let boxes = boxes();
            let Some((_, tested)) = block(&case) else { return Ok(()) };
            let keys = boxes.keys();
            let overlaps = |a: usize, b: usize| {
                (0..3).all(|x| keys[x][a] <= keys[x + 3][b] && keys[x][b] <= keys[x + 3][a])
            };
            let mut compared = BTreeSet::new();
            let n = BoxCount::new(N as u32);
            let budget = WordBudget::new(n, Encoding::Sparse, true, &HeapReply::new());
            let budget = budget.expect("no limit");
            for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
                let Some((mut block, _)) = block(&case) else { return Ok(()) };
                compared.insert(block.test(&boxes, isa));
                let mut sink = WordSink::default();
                let (budget, rules) = (&budget, PairRules::NONE);
                sink.take_block(&block, &Gather { budget, rules, order: &[], isa });
                let mut pairs = Vec::new();
                let mut addresses = Vec::new();
                for [rows, blocks, bits] in sink.chunks() {
                    for ((&row, &block), &bits) in rows.iter().zip(blocks).zip(bits) {
                        prop_assert!(bits != 0);
                        addresses.push((row, block));
                        pairs.extend(
                            (0..32).filter(|t| bits >> t & 1 != 0).map(|t| (row, 32 * block + t)),
                        );
                    }
                }
                prop_assert!(addresses.is_sorted_by(|a, b| a < b), "{}", isa.get());
                prop_assert_eq!(sink.pair_count(), pairs.len() as u64);
                prop_assert!(pairs.iter().all(|(a, b)| overlaps(*a as usize, *b as usize)));
                // Where runs meet in a strip more may be tested than was asked for.
                let pairs: BTreeSet<_> = pairs.into_iter().collect();
                let wanted = tested.iter().filter(|(a, b)| overlaps(*a as usize, *b as usize));
                prop_assert!(wanted.copied().all(|pair| pairs.contains(&pair)), "{}", isa.get());
            }
            prop_assert_eq!(compared.len(), 1, "one number of columns compared");
            prop_assert!(compared.first().is_some_and(|c| *c >= tested.len() as u64));
        }
    }

    #[test]
    fn a_block_without_room_says_so() {
        let mut block = RowBlock::default();
        assert!(block.begin(5..16, 40));
        assert!(block.add(50..100, 1));
        assert!(!block.add(100..400, 1), "19 strips more");
        assert!(block.add(100..400, 0), "no row looks");
        assert!(!block.begin(0..16, 300), "19 strips");
    }
}
