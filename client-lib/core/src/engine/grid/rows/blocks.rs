//! Rows of a line in blocks of up to 16, where no finer level has boxes.
//!
//! The rows of a block look at the cells around all of them, so that which cell a row is in, and
//! whether it reaches the next one along x, does not matter. Where that would be too many strips, the
//! block is the rows of one cell; where it still is, its rows are taken one by one.

use std::ops::Range;

use super::super::level::Reach;
use super::super::neighbours::{REACH_Y, REACH_Z};
use super::{CellSearch, Line, Scene};
use crate::engine::strips::{BLOCK_LANES, RowBlock, RowSet, StripTask};

impl StripTask<CellSearch> {
    /// Rows of one line.
    pub(super) fn run_blocks(&mut self, scene: Scene<'_>, line: Line<'_>, rows: Range<u32>) {
        let Line { level, own, .. } = line;
        let width = own.len() - 1;
        let wraps = level.axes[0].wraps;
        let (mut row, mut x) = (rows.start, 0);
        while row < rows.end {
            while own[x + 1] <= row {
                x += 1;
            }
            let cell_end = own[x + 1].min(rows.end);
            // On the seam of a folded axis the neighbours are not in sequence.
            let seam = wraps && (x == 0 || x == width - 1);
            let most = if wraps { own[width - 1].max(row + 1).min(rows.end) } else { rows.end };
            let mut end = RowBlock::border(row).min(most);
            let mut fits = false;
            if !seam {
                let mut last = x;
                while own[last + 1] < end {
                    last += 1;
                }
                fits = self.cut_block(scene, line, [x, last], row..end);
                if !fits && last > x {
                    end = cell_end;
                    fits = self.cut_block(scene, line, [x, x], row..end);
                }
            }
            if fits {
                self.flush_block(&scene.sorted.boxes, scene.gather);
                if scene.is_over() {
                    return;
                }
            } else {
                end = cell_end;
                self.run_cells(scene, line, x..x + 1, row..end);
            }
            row = end;
        }
    }

    /// Cuts the runs of the rows of cells `first..=last` of a line. `false` when there are too many
    /// strips.
    #[inline(always)]
    fn cut_block(
        &mut self,
        scene: Scene<'_>,
        Line { own, later, .. }: Line<'_>,
        [first, last]: [usize; 2],
        rows: Range<u32>,
    ) -> bool {
        let (start, end) = (first.saturating_sub(1), (last + 2).min(own.len() - 1));
        let block = &mut self.block;
        if !block.begin(rows.clone(), own[end]) {
            return false;
        }
        let reach = &scene.sorted.reach[rows.start as usize..rows.end as usize];
        let reach = RowReach::of(reach, block.all_rows());
        later
            .iter()
            .all(|(starts, needs)| block.add(starts[start]..starts[end], reach.having(*needs)))
    }
}

/// Which rows of a block reach the next cell.
struct RowReach {
    all: RowSet,
    y: RowSet,
    z: RowSet,
}

impl RowReach {
    #[inline(always)]
    fn of(rows: &[Reach], all: RowSet) -> Self {
        let mut bytes = [0; BLOCK_LANES];
        bytes[..rows.len()].copy_from_slice(rows);
        let bytes = u128::from_le_bytes(bytes);
        let with = |bit: Reach| lowest_bits(bytes >> bit.trailing_zeros());
        Self { all, y: with(REACH_Y), z: with(REACH_Z) }
    }

    /// The rows that have all of `needs`, of y and z.
    #[inline(always)]
    fn having(&self, needs: Reach) -> RowSet {
        let y = if needs & REACH_Y == 0 { self.all } else { self.y };
        let z = if needs & REACH_Z == 0 { self.all } else { self.z };
        y & z
    }
}

/// The lowest bit of each of 16 bytes.
#[inline(always)]
fn lowest_bits(bytes: u128) -> RowSet {
    // Byte i times 2^(7(8 − i)) has its bit at 56 + i, and no two sums carry.
    let of_eight =
        |bytes: u64| (bytes & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56;
    (of_eight(bytes as u64) | of_eight((bytes >> 64) as u64) << 8) as RowSet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_reach_are_those_whose_bits_say_so() {
        for seed in 0..1_000u32 {
            let bytes: [Reach; 16] = std::array::from_fn(|i| {
                ((16 * seed + i as u32).wrapping_mul(0x9e37_79b9) >> 29) as Reach
            });
            for len in [1, 7, 16] {
                let all = RowSet::MAX >> (16 - len);
                let reach = RowReach::of(&bytes[..len], all);
                for needs in [0, REACH_Y, REACH_Z, REACH_Y | REACH_Z] {
                    let expected = (0..len).filter(|i| bytes[*i] & needs == needs);
                    let expected = expected.fold(0, |set: RowSet, i| set | 1 << i);
                    assert_eq!(reach.having(needs), expected);
                }
            }
        }
    }
}
