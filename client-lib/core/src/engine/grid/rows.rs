//! One task's rows: their runs, tested and turned into words.

mod blocks;
mod plain;

use std::ops::Range;

use self::plain::PlainCells;
use super::cell_strips::{CellStrips, in_stages};
use super::level::{Level, Reach};
use super::neighbours::{LaterLines, REACH_X, folded};
use super::sort::SortedBoxes;
use crate::aabb::coordinate;
use crate::engine::gather::Gather;
use crate::engine::strips::{GROUP, RowBlock, StripTask};

/// Boxes a cell, on average over a line, from which its rows are not taken in blocks: most blocks
/// would have too many strips, and finding that out takes as long as a tenth of the line.
const CROWDED_CELL: u32 = 12;

/// Tests of columns that take as long as to look a line of finer cells up, and lines after which they are counted.
/// Levels of fewer boxes than that for each line are looked at whole.
const LINE_TESTS: u64 = 32;
const LINES_NOTED: u64 = 1_024;

/// Room that a row must find in the batch: a strip of its own line, and a group.
const ROW_STRIPS: usize = 1 + GROUP;

/// What a task needs beside strips.
#[derive(Default)]
pub struct CellSearch {
    /// Lines of finer cells that were looked up and not yet counted.
    lines: u64,
    plain: PlainCells,
}

/// What all tasks of a frame read.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub sorted: &'a SortedBoxes,
    pub levels: &'a [Level],
    pub gather: &'a Gather<'a>,
}

impl Scene<'_> {
    /// First position of a cell.
    #[inline(always)]
    fn start(&self, cell: u32) -> u32 {
        self.sorted.cell_starts[cell as usize]
    }

    fn positions(&self, level: &Level) -> Range<u32> {
        self.start(level.first_cell)..self.start(level.first_cell + level.cell_count())
    }

    /// Whether the budget is spent: then rows need not be looked at.
    #[inline(always)]
    fn is_over(&self) -> bool {
        self.gather.budget.is_spent()
    }

    fn cell_of(&self, position: u32) -> u32 {
        self.sorted.cell_starts.partition_point(|start| *start <= position) as u32 - 1
    }
}

/// A line of a level's cells, and what its rows look at.
#[derive(Clone, Copy)]
struct Line<'a> {
    level: &'a Level,
    /// First positions of its cells, and their end.
    own: &'a [u32],
    /// The same of the later lines around it, and what a row must reach to look there.
    later: &'a [(&'a [u32], Reach)],
    finer: &'a [Level],
}

impl StripTask<CellSearch> {
    /// Finds the words of all rows, until the budget is spent.
    pub(super) fn search(&mut self, scene: Scene<'_>) {
        self.begin();
        self.own.lines = 0;
        for (i, level) in scene.levels.iter().enumerate().rev() {
            let positions = scene.positions(level);
            let rows = positions.start.max(self.rows.start)..positions.end.min(self.rows.end);
            if rows.start < rows.end {
                self.run_level(scene, level, &scene.levels[..i], rows);
            }
        }
        self.finish(&scene.sorted.boxes, scene.gather);
    }

    /// Rows of one level, line by line.
    fn run_level(&mut self, scene: Scene<'_>, level: &Level, finer: &[Level], rows: Range<u32>) {
        let width = level.axes[0].cell_count;
        let first_line = (scene.cell_of(rows.start) - level.first_cell) / width;
        let last_line = (scene.cell_of(rows.end - 1) - level.first_cell) / width;
        let alone = finer.iter().all(|c| scene.positions(c).is_empty());
        for line in first_line..=last_line {
            if scene.is_over() {
                return;
            }
            let height = level.axes[1].cell_count;
            let first_cell = level.first_cell + line * width;
            let here = scene.start(first_cell)..scene.start(first_cell + width);
            let rows = here.start.max(rows.start)..here.end.min(rows.end);
            if rows.start >= rows.end {
                continue;
            }
            let later = LaterLines::of(level, line % height, line / height);
            let finer = if alone { &[] } else { finer };
            let line_starts =
                |first: u32| &scene.sorted.cell_starts[first as usize..][..=width as usize];
            let own = line_starts(first_cell);
            let mut lines: [(&[u32], Reach); 8] = [(&[], 0); 8];
            for (slot, line) in lines.iter_mut().zip(later.as_slice()) {
                *slot = (line_starts(line.first_cell), line.needs);
            }
            let line = Line { level, own, later: &lines[..later.as_slice().len()], finer };
            let crowded = here.end - here.start > CROWDED_CELL * width;
            if finer.is_empty() && !crowded && RowBlock::pays(scene.gather.isa) {
                self.run_blocks(scene, line, rows);
            } else {
                self.run_cells(scene, line, 0..width as usize, rows);
            }
        }
    }

    /// Rows of some cells of a line, cell by cell.
    fn run_cells(
        &mut self,
        scene: Scene<'_>,
        line: Line<'_>,
        cells: Range<usize>,
        rows: Range<u32>,
    ) {
        let Line { level, own, later: lines, finer } = line;
        let width = own.len() - 1;
        let staged = in_stages(lines.iter().map(|(_, needs)| *needs));
        let mut strips = CellStrips::new();
        let mut next = cells.start;
        while next < cells.end {
            if finer.is_empty() && staged {
                next = self.run_plain(scene, line, next..cells.end, &rows);
                if next == cells.end || scene.is_over() {
                    return;
                }
            }
            let x = next;
            next += 1;
            let cell = own[x].max(rows.start)..own[x + 1].min(rows.end);
            if cell.start >= cell.end {
                continue;
            }
            let seam = level.axes[0].wraps && (x == 0 || x == width - 1);
            // Up to this cell, or up to the next one for boxes that reach it.
            let ends = [x + 1, (x + 2).min(width)];
            let runs = lines.iter().map(|(starts, needs)| {
                (starts[x.saturating_sub(1)], ends.map(|end| starts[end]), *needs)
            });
            if seam || !staged || !strips.cut(runs) {
                self.run_odd_cell(scene, line, x, cell);
                continue;
            }
            let own_ends = ends.map(|end| own[end]);
            for row in cell {
                let reach = scene.sorted.reach[row as usize];
                let far = usize::from(reach & REACH_X);
                if self.batch.room() < ROW_STRIPS {
                    self.flush_in(scene);
                    if scene.is_over() {
                        return;
                    }
                }
                // Most rows have one strip in their own line and at most a group elsewhere: both
                // are pushed without asking whether there is anything.
                let next = self.batch.push(row, row + 1, own_ends[far]);
                if next < own_ends[far] {
                    self.push(scene, row, next, own_ends[far]);
                    if self.batch.room() < GROUP {
                        self.flush_in(scene);
                    }
                }
                let (first, end) = strips.of_row(reach);
                self.batch.push_group(row, &strips.group(first, end, far));
                if end > first + GROUP {
                    self.push_groups(scene, row, &strips, first + GROUP..end, far);
                }
                if !finer.is_empty() {
                    self.push_finer(scene, finer, row);
                    if scene.is_over() {
                        return;
                    }
                }
            }
        }
    }

    /// Rows of a cell whose strips are no list: on the seam of a folded axis, or crowded.
    fn run_odd_cell(&mut self, scene: Scene<'_>, line: Line<'_>, x: usize, cell: Range<u32>) {
        let Line { level, own, later: lines, finer } = line;
        let width = own.len() - 1;
        for row in cell {
            if scene.is_over() {
                return;
            }
            let reach = scene.sorted.reach[row as usize];
            let far = usize::from(reach & REACH_X);
            self.push(scene, row, row + 1, own[(x + 1 + far).min(width)]);
            if x == 0 && level.axes[0].wraps {
                self.push(scene, row, own[width - 1], own[width]);
            }
            for (starts, needs) in lines {
                if needs & !reach == 0 {
                    let high = x as i32 + i32::from(reach & REACH_X);
                    for cells in folded(&level.axes[0], x as i32 - 1, high) {
                        let (start, end) =
                            (starts[cells.start as usize], starts[cells.end as usize]);
                        self.push(scene, row, start, end);
                    }
                }
            }
            self.push_finer(scene, finer, row);
        }
    }

    /// The runs of a row in all finer levels: few rows have any, and each takes as many cells as
    /// it covers, so that a giant costs about as much as it has pairs.
    fn push_finer(&mut self, scene: Scene<'_>, finer: &[Level], row: u32) {
        let keys = scene.sorted.boxes.keys();
        let mut lines = 0;
        let coordinate = |component: usize| coordinate(keys[component][row as usize]);
        let min: [f32; 3] = std::array::from_fn(coordinate);
        let max: [f32; 3] = std::array::from_fn(|axis| coordinate(3 + axis));
        // From coarse to fine: in the order of positions.
        for level in finer.iter().rev() {
            let numbers: [[i32; 2]; 3] = std::array::from_fn(|axis| {
                [min[axis], max[axis]].map(|x| level.axes[axis].cell(x))
            });
            if (0..3).any(|axis| level.axes[axis].is_beyond(numbers[axis])) {
                continue;
            }
            let [xs, ys, zs]: [[Range<u32>; 2]; 3] = std::array::from_fn(|axis| {
                let [low, high] = numbers[axis];
                folded(&level.axes[axis], low - 1, high)
            });
            let positions = scene.positions(level);
            let [height, depth] =
                [&ys, &zs].map(|of| of.iter().map(|cells| cells.len() as u64).sum::<u64>());
            if positions.len() as u64 <= LINE_TESTS * height * depth {
                self.push(scene, row, positions.start, positions.end);
                continue;
            }
            for z in zs.into_iter().flatten() {
                for y in ys.iter().cloned().flatten() {
                    lines += 1;
                    for x in &xs {
                        let start = scene.start(level.cell_at([x.start, y, z]));
                        let end = scene.start(level.cell_at([x.end, y, z]));
                        self.push(scene, row, start, end);
                    }
                }
            }
        }
        self.own.lines += lines;
        if self.own.lines >= LINES_NOTED {
            self.found.note_tests(LINE_TESTS * self.own.lines, 0, scene.gather);
            self.own.lines = 0;
        }
    }

    /// Further groups of a row.
    #[inline(never)]
    fn push_groups(
        &mut self,
        scene: Scene<'_>,
        row: u32,
        strips: &CellStrips,
        of_row: Range<usize>,
        far: usize,
    ) {
        for first in of_row.clone().step_by(GROUP) {
            if self.batch.room() < GROUP {
                self.flush_in(scene);
            }
            self.batch.push_group(row, &strips.group(first, of_row.end, far));
        }
    }

    fn flush_in(&mut self, scene: Scene<'_>) {
        self.flush(&scene.sorted.boxes, scene.gather);
    }

    /// A run of a row, strip by strip.
    #[inline(always)]
    fn push(&mut self, scene: Scene<'_>, row: u32, start: u32, end: u32) {
        if self.batch.room() == 0 {
            self.flush_in(scene);
        }
        let mut next = self.batch.push(row, start, end);
        while next < end {
            if self.batch.room() == 0 {
                self.flush_in(scene);
            }
            next = self.batch.push(row, next, end);
        }
    }
}
