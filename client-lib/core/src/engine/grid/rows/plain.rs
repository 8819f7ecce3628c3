//! Rows of plain cells: those whose rows have a strip at most in their own line and a few elsewhere, as
//! nearly all have where cells are not crowded.
//!
//! The strips of some cells are cut first, then their rows are pushed, in one loop without a branch on a
//! cell or row: how many rows a cell has, and how many strips a row, is hard to predict.

use std::ops::Range;

use super::super::level::Reach;
use super::super::neighbours::REACH_X;
use super::{CellSearch, Line, Scene};
use crate::engine::strips::{BATCH_STRIPS, GROUP, STRIP_COLUMNS, StripGroup, StripTask};

/// Cells that are cut together: 2 KiB of strips.
const CELLS: usize = 16;
/// Most rows of these cells: a batch that is empty has room for all of their strips.
const ROWS: u32 = 96;
const _: () = assert!(ROWS as usize * GROUP < BATCH_STRIPS);
/// Most strips of a cell, so that those of a row are a group with the one of its own line.
const STRIPS: usize = GROUP - 1;
/// Columns that two strips hold: those of a run are written at a time, needed or not.
const TWO_STRIPS: u32 = 2 * STRIP_COLUMNS as u32;

/// Cells of a line in sequence, none of them empty.
#[derive(Default)]
pub(super) struct PlainCells {
    cells: [PlainCell; CELLS],
    ends: [u32; CELLS],
    len: usize,
    /// Most strips that a row may have.
    row_strips: usize,
}

/// The strips of the later lines around a cell, and what of them a row looks at.
#[derive(Default)]
struct PlainCell {
    starts: [u32; 2 * GROUP],
    /// Columns of each strip, for rows that do not reach into the next cell along x, and for those
    /// that do.
    lanes: [[u16; 2 * GROUP]; 2],
    /// First strip and number of strips of a row, by its reach in y and z: none, y, z, both.
    spans: [[u8; 2]; 4],
    /// Where the columns of a row in its own line end, near and far.
    own_ends: [u32; 2],
}

impl PlainCell {
    /// Cuts the runs of cell `x`, as [`super::CellStrips`] does; returns the number of strips, or `None`
    /// where the cell is not plain.
    #[inline(always)]
    fn cut(
        &mut self,
        lines: &[(&[u32], Reach)],
        before: usize,
        [near, far]: [usize; 2],
    ) -> Option<usize> {
        let mut len = 0;
        // End of the strips with each need, in the order of the lines.
        let mut ends = [0; 4];
        for (starts, needs) in lines {
            let (start, near, far) = (starts[before], starts[near], starts[far]);
            let count = (far - start).div_ceil(STRIP_COLUMNS as u32) as usize;
            if far - start > TWO_STRIPS || len + count > STRIPS {
                return None;
            }
            (self.starts[len], self.starts[len + 1]) = (start, start + STRIP_COLUMNS as u32);
            for (lanes, end) in self.lanes.iter_mut().zip([near, far]) {
                let columns = (1u64 << (end - start)) - 1;
                (lanes[len], lanes[len + 1]) = (columns as u16, (columns >> STRIP_COLUMNS) as u16);
            }
            len += count;
            ends[usize::from(needs >> 1) % 4] = len;
        }
        let (y, z) = (ends[1], ends[2].max(ends[1]));
        let span = |first: usize, end: usize| [first as u8, (end - first) as u8];
        self.spans = [span(0, 0), span(0, y), span(y, z), span(0, len)];
        Some(len)
    }

    /// The strips that a row looks at.
    #[inline(always)]
    fn group(&self, reach: Reach, far: usize) -> StripGroup<'_> {
        let [first, count] = self.spans[usize::from(reach >> 1) % 4].map(usize::from);
        StripGroup {
            starts: group_at(&self.starts, first),
            lanes: group_at(&self.lanes[far % 2], first),
            count,
        }
    }
}

/// The group that starts at `first`, of [`STRIPS`].
#[inline(always)]
fn group_at<T>(all: &[T; 2 * GROUP], first: usize) -> &[T; GROUP] {
    match all[first % GROUP..].first_chunk() {
        Some(group) => group,
        None => unreachable!("two groups hold one at each place of the first"),
    }
}

impl PlainCells {
    /// Cuts cells from the first of `cells` on, as many as are plain and as there is room for. Returns
    /// the cell after them, and their rows.
    #[inline(always)]
    fn cut(
        &mut self,
        own: &[u32],
        lines: &[(&[u32], Reach)],
        cells: Range<usize>,
        rows: &Range<u32>,
    ) -> (usize, Range<u32>) {
        let width = own.len() - 1;
        let first = own[cells.start].max(rows.start);
        let mut end = first;
        (self.len, self.row_strips) = (0, 1);
        for x in cells.clone() {
            let (cell_start, cell_end) = (own[x].max(rows.start), own[x + 1].min(rows.end));
            if cell_start >= cell_end {
                continue;
            }
            // Up to this cell, or up to the next one for boxes that reach it.
            let ends = [x + 1, (x + 2).min(width)];
            let own_ends = ends.map(|end| own[end]);
            let own_most = own_ends[1] - cell_start - 1;
            if self.len == CELLS || cell_end - first > ROWS || own_most > STRIP_COLUMNS as u32 {
                return (x, first..end);
            }
            let cell = &mut self.cells[self.len];
            let Some(strips) = cell.cut(lines, x.saturating_sub(1), ends) else {
                return (x, first..end);
            };
            cell.own_ends = own_ends;
            self.ends[self.len] = cell_end;
            self.row_strips = self.row_strips.max(1 + strips);
            self.len += 1;
            end = cell_end;
        }
        (cells.end, first..end)
    }
}

impl StripTask<CellSearch> {
    /// Rows of plain cells from the first of `cells` on, whose lines are in stages. Returns the first cell
    /// that is not plain.
    pub(super) fn run_plain(
        &mut self,
        scene: Scene<'_>,
        Line { level, own, later, .. }: Line<'_>,
        cells: Range<usize>,
        rows: &Range<u32>,
    ) -> usize {
        // On the seam of a folded axis the neighbours are not in sequence.
        let seam = usize::from(level.axes[0].wraps);
        let end = cells.end.min(own.len() - 1 - seam);
        let mut next = cells.start;
        while seam <= next && next < end {
            let (cell, rows) = self.own.plain.cut(own, later, next..end, rows);
            if rows.is_empty() {
                return cell;
            }
            next = cell;
            if self.batch.room() <= rows.len() * self.own.plain.row_strips {
                self.flush_in(scene);
                if scene.is_over() {
                    return next;
                }
            }
            self.push_plain(scene, rows);
        }
        next
    }

    /// Pushes the strips of the rows of the cells that were cut.
    #[inline(always)]
    fn push_plain(&mut self, scene: Scene<'_>, rows: Range<u32>) {
        let PlainCells { cells, ends, .. } = &self.own.plain;
        let reach = &scene.sorted.reach[rows.start as usize..rows.end as usize];
        self.batch.push_all(|slots| {
            let mut at = 0;
            for (row, &reach) in rows.zip(reach) {
                let cell = &cells[at % CELLS];
                let far = usize::from(reach & REACH_X);
                let columns = cell.own_ends[far] - (row + 1);
                let lanes = ((1u32 << columns) - 1) as u16;
                slots.push_row(row, row + 1, lanes, &cell.group(reach, far));
                at += usize::from(row + 1 == ends[at % CELLS]);
            }
        });
    }
}
