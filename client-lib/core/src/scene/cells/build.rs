//! Placing all boxes at once.

use super::block::{Block, SLOTS, STATIC, Slot};
use super::layout::{self, Level};
use super::runs::{NOWHERE, Runs};
use super::{Cells, level_of};
use crate::aabb::Aabb;
use crate::aabb::is_valid;
use crate::team::{for_each_in_parts, part_count, zip_in_parts};

const TASK_BOXES: usize = 16_384;

impl Cells {
    /// Chooses the layout for boxes and places every one, as it is. None has changed then.
    pub fn build(
        &mut self,
        boxes: &[Aabb],
        is_static: impl Fn(u32) -> bool + Sync,
        threads: usize,
    ) {
        // The old ones first: there need not be memory for both.
        *self = Self { levels: layout::choose(boxes), ..Self::default() };
        let cells = self.levels.iter().map(|level| level.first_cell + level.cell_count()).max();
        let mut positions = vec![NOWHERE; boxes.len()];
        zip_in_parts(&mut positions, boxes, TASK_BOXES, threads, |homes, boxes| {
            for (home, b) in homes.iter_mut().zip(boxes).filter(|(_, b)| is_valid(b)) {
                let (level, q) = level_of(&self.levels, b);
                *home = self.levels[level].home(&q);
            }
        });
        let mut counts = vec![0u32; cells.unwrap_or(0) as usize];
        for home in positions.iter().filter(|home| **home != NOWHERE) {
            counts[*home as usize] += 1;
        }
        let of_level = |level: &Level| {
            let first = level.first_cell as usize;
            counts[first..first + level.cell_count() as usize].iter().sum()
        };
        self.occupied = self.levels.iter().map(of_level).collect();
        self.runs = Runs::with_room(&counts);
        for position in positions.iter_mut().filter(|position| **position != NOWHERE) {
            *position = self.runs.reserve(*position);
        }
        let fill_threads = part_count(boxes.len(), TASK_BOXES, threads).min(threads);
        let blocks = self.runs.blocks_mut();
        let step = blocks.len().div_ceil(fill_threads).max(1);
        let firsts = (0u32..).step_by(step * SLOTS as usize);
        let mut fills: Vec<(u32, &mut [Block])> = firsts.zip(blocks.chunks_mut(step)).collect();
        let levels = self.levels.as_slice();
        for_each_in_parts(&mut fills, fill_threads, |(first, blocks)| {
            let count = blocks.len() as u32 * SLOTS;
            for ((index, position), b) in (0u32..).zip(&positions).zip(boxes) {
                // That of a box elsewhere, or nowhere, is beyond the end.
                let at = position.wrapping_sub(*first);
                if at < count {
                    let (_, q) = level_of(levels, b);
                    let word = index | if is_static(index) { STATIC } else { 0 };
                    blocks[(at / SLOTS) as usize].0[(at % SLOTS) as usize] = Slot::new(&q, word);
                }
            }
        });
        self.positions = positions;
    }
}
