//! Runs of blocks, one for each cell: filled from the front, and moved where they grow, or half of them is empty.

use super::block::{Block, SLOTS, Slot};
use crate::fetch::ask_for;
use crate::huge_pages;

/// No place, and no cell.
pub(super) const NOWHERE: u32 = u32::MAX;
/// Runs up to this length go to other cells when theirs leave them; longer ones are left until the cells are built anew.
const REUSED_MOST: usize = 64;
/// Blocks of a run from which on it has room for one in so many more in the beginning: else each of many would be left by
/// the first box that comes, and the cells be built anew edit by edit. Shorter ones are as often left as they are used
/// again.
const ROOM_FROM: u32 = 8;
const ROOM_SHARE: u32 = 4;
/// Blocks beyond those of the beginning, one for each so many, that may be used before the cells are to be
/// built anew; and so many more.
const SPARE_SHARE: usize = 2;
const SPARE_LEAST: usize = 1_024;

/// The blocks of a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Run {
    pub start: u32,
    pub len: u32,
    room: u32,
}

impl Run {
    #[inline(always)]
    pub const fn positions(&self) -> std::ops::Range<u32> {
        let first = self.start * SLOTS;
        first..first + self.len
    }

    /// Blocks that hold boxes.
    #[inline(always)]
    pub const fn blocks(&self) -> u32 {
        self.len.div_ceil(SLOTS)
    }
}

#[derive(Debug, Default)]
pub(super) struct Runs {
    of_cells: Vec<Run>,
    blocks: Vec<Block>,
    /// The cell of each block.
    owners: Vec<u32>,
    /// First blocks of runs without a cell, by length.
    free: Vec<Vec<u32>>,
    /// Blocks at the beginning.
    built: usize,
}

impl Runs {
    /// Runs with room for so many boxes in each cell, all of them empty.
    pub fn with_room(counts: &[u32]) -> Self {
        let mut next = 0;
        let mut runs = Vec::with_capacity(counts.len());
        huge_pages::prefer(&runs);
        for count in counts {
            let filled = count.div_ceil(SLOTS);
            let room = filled + if filled < ROOM_FROM { 0 } else { filled / ROOM_SHARE };
            runs.push(Run { start: next, len: 0, room });
            next += room;
        }
        let built = next as usize;
        let most = built + built / SPARE_SHARE + SPARE_LEAST;
        let mut owners = Vec::with_capacity(most);
        for (cell, run) in (0u32..).zip(&runs) {
            owners.resize(owners.len() + run.room as usize, cell);
        }
        let mut blocks = Vec::with_capacity(most);
        huge_pages::prefer(&blocks);
        blocks.resize(built, Block::NONE);
        Self { of_cells: runs, blocks, owners, free: Vec::new(), built }
    }

    /// Makes a place for one more box of a cell that has room.
    pub fn reserve(&mut self, cell: u32) -> u32 {
        let run = &mut self.of_cells[cell as usize];
        let position = run.positions().end;
        run.len += 1;
        position
    }

    pub fn blocks_mut(&mut self) -> &mut [Block] {
        &mut self.blocks
    }

    /// The runs of neighbouring cells.
    #[inline(always)]
    pub fn runs(&self, first: u32, count: u32) -> &[Run] {
        &self.of_cells[first as usize..(first + count) as usize]
    }

    #[inline(always)]
    pub fn ask_for_run(&self, cell: u32) {
        ask_for(&self.of_cells, cell);
    }

    #[inline(always)]
    pub fn ask_for_block(&self, block: u32) {
        ask_for(&self.blocks, block);
    }

    #[inline(always)]
    pub fn ask_for_slot(&self, position: u32) {
        ask_for(&self.owners, position / SLOTS);
        ask_for(&self.blocks, position / SLOTS);
    }

    #[inline(always)]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    #[inline(always)]
    pub fn cell_of(&self, position: u32) -> u32 {
        self.owners[(position / SLOTS) as usize]
    }

    #[inline(always)]
    pub fn slot_mut(&mut self, position: u32) -> &mut Slot {
        &mut self.blocks[(position / SLOTS) as usize].0[(position % SLOTS) as usize]
    }

    /// Takes the box at a place away. Calls `moved` with the word of each box that moves, where it was and where it is: the
    /// last one of its cell, which comes in its place, and all of a cell that goes to a shorter run.
    pub fn remove(&mut self, position: u32, mut moved: impl FnMut(u32, u32, u32)) {
        let cell = self.cell_of(position);
        let run = &mut self.of_cells[cell as usize];
        run.len -= 1;
        let last = run.start * SLOTS + run.len;
        if last != position {
            let slot = *self.slot_mut(last);
            *self.slot_mut(position) = slot;
            moved(slot.word(), last, position);
        }
        self.shrink(cell, moved);
    }

    /// Puts a box into a cell that has room: returns its place.
    pub fn push(&mut self, cell: u32, slot: Slot) -> Option<u32> {
        let run = self.of_cells[cell as usize];
        if run.len == run.room * SLOTS {
            return None;
        }
        let position = self.reserve(cell);
        *self.slot_mut(position) = slot;
        Some(position)
    }

    /// Gives a full cell more room. Calls `moved` with the word of each of its boxes, where it was and
    /// where it is.
    pub fn grow(&mut self, cell: u32, moved: impl FnMut(u32, u32, u32)) {
        let old = self.of_cells[cell as usize];
        let room = old.room + (old.room / 2).max(1);
        let start = self.take_free(room).unwrap_or_else(|| {
            let end = self.blocks.len();
            self.blocks.resize(end + room as usize, Block::NONE);
            self.owners.resize(end + room as usize, NOWHERE);
            end as u32
        });
        self.move_run(cell, start, room, moved);
    }

    /// Takes room from a cell that needs no more than half of it, where a run of the right length is free, and cells that grow
    /// can have its own.
    fn shrink(&mut self, cell: u32, moved: impl FnMut(u32, u32, u32)) {
        let old = self.of_cells[cell as usize];
        let room = old.blocks();
        if 2 * room <= old.room
            && old.room as usize <= REUSED_MOST
            && let Some(start) = self.take_free(room)
        {
            self.move_run(cell, start, room, moved);
        }
    }

    /// Moves a cell to a free run.
    fn move_run(&mut self, cell: u32, start: u32, room: u32, mut moved: impl FnMut(u32, u32, u32)) {
        let old = self.of_cells[cell as usize];
        self.owners[start as usize..(start + room) as usize].fill(cell);
        self.of_cells[cell as usize] = Run { start, len: old.len, room };
        let from = old.start as usize;
        self.blocks.copy_within(from..from + old.blocks() as usize, start as usize);
        for (from, to) in old.positions().zip(start * SLOTS..) {
            moved(self.slot_mut(to).word(), from, to);
        }
        if (1..=REUSED_MOST).contains(&(old.room as usize)) {
            if self.free.len() <= old.room as usize {
                self.free.resize_with(old.room as usize + 1, Vec::new);
            }
            self.free[old.room as usize].push(old.start);
        }
    }

    /// A run without a cell; one of no blocks there always is.
    fn take_free(&mut self, room: u32) -> Option<u32> {
        if room == 0 { Some(0) } else { self.free.get_mut(room as usize)?.pop() }
    }

    /// Whether growth has taken so much memory that the cells are to be built anew.
    pub fn are_spread(&self) -> bool {
        self.blocks.len() > self.built + self.built / SPARE_SHARE + SPARE_LEAST
    }

    pub fn allocated_bytes(&self) -> usize {
        self.of_cells.capacity() * size_of::<Run>()
            + self.blocks.capacity() * size_of::<Block>()
            + self.owners.capacity() * size_of::<u32>()
            + self.free.iter().map(|free| free.capacity() * size_of::<u32>()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_for_each_of_many_long_runs_is_no_reason_to_build_them_anew() {
        for count in [32, 200, 400, 2_000] {
            let mut runs = Runs::with_room(&[count; 1_000]);
            for cell in 0..1_000 {
                (0..count).for_each(|_| _ = runs.reserve(cell));
                if runs.push(cell, Slot::NONE).is_none() {
                    runs.grow(cell, |_, _, _| ());
                    assert!(runs.push(cell, Slot::NONE).is_some());
                }
            }
            assert!(!runs.are_spread(), "{count}");
        }
    }
}
