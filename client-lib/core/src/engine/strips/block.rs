//! Blocks: up to 16 consecutive rows against the strips that they share.
//!
//! Rows that follow each other in a line of cells look at nearly the same columns. A block cuts those
//! into strips once, and the columns of a strip are loaded once for all of its rows. Both lie on
//! 16-borders of the positions, so that a strip is one half of a mask word and nothing has to be
//! shifted from one word into the next.

use std::ops::Range;

use super::STRIP_COLUMNS;
#[cfg(target_arch = "x86_64")]
use super::block_avx512;
use super::ordered::OrderedBoxes;
use super::sink::WordChunk;
use crate::engine::{AvailableIsa, Isa};

/// Most rows of a block, and most strips: the lanes of a register, and columns of a strip.
pub(crate) const BLOCK_LANES: usize = STRIP_COLUMNS;

/// Strips that are written at a time, needed or not.
const AT_A_TIME: usize = 4;

/// Room for those behind the last one that were not needed.
const ALLOCATED: usize = BLOCK_LANES + AT_A_TIME;

/// See [`RowBlock::pays`].
const NO_BLOCKS: &str = "blocks are for AVX-512";

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
        match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => block_avx512::test(&boxes.keys(), self, isa),
            _ => unreachable!("{NO_BLOCKS}"),
        }
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
            _ => unreachable!("{NO_BLOCKS}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
