//! The strips that the rows of one cell share, cut once for all of them.
//!
//! Lines come in the order of what they need of a row: y, z, z, y and z. So what a row looks at is
//! one stretch of the list, and is copied into the batch without looking at its strips.

use super::level::Reach;
use super::neighbours::{REACH_Y, REACH_Z};
use crate::engine::strips::{GROUP, STRIP_COLUMNS, StripGroup};

/// Most strips of a cell. A cell with more is crowded, and its rows cut their own.
const CELL_STRIPS: usize = 56;
/// Room for a group that starts at the last strip.
const ALLOCATED: usize = CELL_STRIPS + GROUP;

/// Strips of the later lines around a cell.
pub(super) struct CellStrips {
    starts: [u32; ALLOCATED],
    /// Columns of each strip, for rows that do not reach into the next cell along x, and for those
    /// that do.
    lanes: [[u16; ALLOCATED]; 2],
    len: usize,
    /// First strip of the lines with each need, in their order; see [`stage`].
    firsts: [usize; 4],
}

/// Place of a need in the order of the lines, or `None` for lines that every row looks at (on the
/// seam of a folded axis).
fn stage(needs: Reach) -> Option<usize> {
    match needs {
        REACH_Y => Some(0),
        REACH_Z => Some(1),
        n if n == REACH_Y | REACH_Z => Some(2),
        _ => None,
    }
}

/// Whether lines with these needs, in this order, can be a list of strips.
pub(super) fn in_stages(needs: impl Iterator<Item = Reach> + Clone) -> bool {
    let stages = needs.map(stage);
    stages.clone().all(|s| s.is_some()) && stages.is_sorted()
}

impl CellStrips {
    pub const fn new() -> Self {
        Self { starts: [0; ALLOCATED], lanes: [[0; ALLOCATED]; 2], len: 0, firsts: [0; 4] }
    }

    /// Cuts the runs of a cell: of each line the first position, the ends (near and far) and what
    /// it needs. `false` when there are too many strips.
    #[inline(always)]
    pub fn cut(&mut self, runs: impl Iterator<Item = (u32, [u32; 2], Reach)>) -> bool {
        self.len = 0;
        let mut stages_done = 0;
        for (start, [near, far], needs) in runs {
            let stage = stage(needs).unwrap_or(0);
            while stages_done <= stage {
                self.firsts[stages_done] = self.len;
                stages_done += 1;
            }
            let mut start = start;
            while start < far {
                if self.len == CELL_STRIPS {
                    return false;
                }
                self.starts[self.len] = start;
                self.lanes[0][self.len] = lanes(start, near);
                self.lanes[1][self.len] = lanes(start, far);
                self.len += 1;
                start += STRIP_COLUMNS as u32;
            }
        }
        while stages_done < 4 {
            self.firsts[stages_done] = self.len;
            stages_done += 1;
        }
        true
    }

    /// Which strips a row looks at.
    #[inline(always)]
    pub fn of_row(&self, reach: Reach) -> (usize, usize) {
        // Reach in y and z: none, y, z, both.
        const STAGES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 2), (0, 3)];
        let (first, end) = STAGES[usize::from(reach >> 1) % 4];
        (self.firsts[first], self.firsts[end])
    }

    /// The group of strips `first..end`, or its first [`GROUP`]. It may be empty.
    #[inline(always)]
    pub fn group(&self, first: usize, end: usize, far: usize) -> StripGroup<'_> {
        let first = first.min(CELL_STRIPS);
        StripGroup {
            starts: array_at(&self.starts, first),
            lanes: array_at(&self.lanes[far % 2], first),
            count: end.saturating_sub(first).min(GROUP),
        }
    }
}

/// The group that starts at `first`, which is at most [`CELL_STRIPS`].
#[inline(always)]
fn array_at<T>(all: &[T; ALLOCATED], first: usize) -> &[T; GROUP] {
    const { assert!(CELL_STRIPS + GROUP <= ALLOCATED) };
    match all[first..].first_chunk() {
        Some(group) => group,
        None => unreachable!("{first} is at most {CELL_STRIPS}"),
    }
}

/// Columns `start..end` of a strip.
#[inline(always)]
fn lanes(start: u32, end: u32) -> u16 {
    let count = end.saturating_sub(start).min(STRIP_COLUMNS as u32);
    ((1u32 << count) - 1) as u16
}
