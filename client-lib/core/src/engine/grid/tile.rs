//! First pass: each tile of the input into buckets of neighbouring cells.

use super::homes::{self, CELL_MASK};
use super::level::Level;
use super::sort::{BUCKET_MOST, Deal, TILE_MOST};
use crate::aabb::Aabb;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::{AvailableIsa, Census};
use crate::team::{Split, in_parts, part_count};

/// Boxes of a tile whose homes are 4 KiB: to clear room for the largest tile would take a small scene as
/// long as to deal it, and empty its first-level cache.
const SMALL_TILE: usize = 1_024;

/// A box on its way: 32 bytes, two to a cache line.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Record {
    pub aabb: Aabb,
    pub index: u32,
    /// Cell and reach, see [`CELL_MASK`].
    pub home: u32,
}

/// A range of tiles: their boxes, and room for what becomes of them.
pub(super) struct Tiles<'a> {
    pub boxes: &'a [Aabb],
    pub first_index: u32,
    pub records: &'a mut [Record],
    /// Of each tile, where each bucket ends within the tile.
    pub ends: &'a mut [u32],
    pub deal: Deal,
}

impl Split for Tiles<'_> {
    fn len(&self) -> usize {
        self.boxes.len().div_ceil(self.deal.tile_len)
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let box_count = at * self.deal.tile_len;
        let (boxes, later_boxes) = self.boxes.split_at(box_count);
        let (records, later_records) = self.records.split_at_mut(box_count);
        let (ends, later_ends) = self.ends.split_at_mut(at * self.deal.bucket_count);
        let later = Self {
            boxes: later_boxes,
            first_index: self.first_index + box_count as u32,
            records: later_records,
            ends: later_ends,
            deal: self.deal,
        };
        (Self { boxes, records, ends, ..self }, later)
    }
}

impl Tiles<'_> {
    /// Deals the boxes of all tiles, unless cancelled. What overlaps nothing goes to the cell `nothing`.
    pub fn run(self, levels: &[Level], nothing: u32, isa: AvailableIsa, cancel: &Cancel) -> Census {
        let parts = part_count(self.len(), 1, self.deal.threads);
        let deal = |tiles: Self| tiles.deal(levels, nothing, isa, cancel);
        in_parts(self, parts, &deal, &|low, high| low.then(&high))
    }

    fn deal(self, levels: &[Level], nothing: u32, isa: AvailableIsa, cancel: &Cancel) -> Census {
        if self.deal.tile_len <= SMALL_TILE {
            self.deal_with(&mut [0; SMALL_TILE], levels, nothing, isa, cancel)
        } else {
            self.deal_large(levels, nothing, isa, cancel)
        }
    }

    /// Apart, so that small tiles do without its stack.
    #[inline(never)]
    fn deal_large(
        self,
        levels: &[Level],
        nothing: u32,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Census {
        // 64 KiB: of a stack of 2 MiB or more, and of the second-level cache.
        #[allow(clippy::large_stack_arrays)]
        let mut homes = [0u32; TILE_MOST];
        self.deal_with(&mut homes, levels, nothing, isa, cancel)
    }

    /// Deals with room for the homes of a tile.
    #[inline(always)]
    fn deal_with(
        self,
        homes: &mut [u32],
        levels: &[Level],
        nothing: u32,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Census {
        let mut pace = Pace::default();
        let mut census = Census::default();
        let mut index = self.first_index;
        let boxes = self.boxes.chunks(self.deal.tile_len);
        let records = self.records.chunks_mut(self.deal.tile_len);
        let ends = self.ends.chunks_exact_mut(self.deal.bucket_count);
        for ((boxes, records), ends) in boxes.zip(records).zip(ends) {
            if cancel.look_after(BOX_TESTS * boxes.len() as u64, &mut pace) {
                break;
            }
            let homes = &mut homes[..boxes.len()];
            census = census.then(&homes::find(boxes, index, levels, nothing, homes, isa));
            deal_tile(boxes, index, homes, records, ends, self.deal.bucket_shift);
            index += boxes.len() as u32;
        }
        census
    }
}

/// One tile's boxes into its records, by bucket.
fn deal_tile(
    boxes: &[Aabb],
    first_index: u32,
    homes: &[u32],
    records: &mut [Record],
    ends: &mut [u32],
    bucket_shift: u32,
) {
    if let [end] = ends {
        // Nothing to be dealt, and the one counter would be waited for at every box.
        let boxes = boxes.iter().zip(homes).zip(first_index..);
        for (record, ((aabb, &home), index)) in records.iter_mut().zip(boxes) {
            *record = Record { aabb: *aabb, index, home };
        }
        *end = records.len() as u32;
        return;
    }
    let bucket_of = |home: u32| ((home & CELL_MASK) >> bucket_shift) as usize % BUCKET_MOST;
    let mut next = [0u32; BUCKET_MOST];
    for &home in homes {
        next[bucket_of(home)] += 1;
    }
    let mut start = 0;
    for (end, next) in ends.iter_mut().zip(&mut next) {
        let count = *next;
        *next = start;
        start += count;
        *end = start;
    }
    for ((aabb, &home), index) in boxes.iter().zip(homes).zip(first_index..) {
        let at = &mut next[bucket_of(home)];
        records[*at as usize] = Record { aabb: *aabb, index, home };
        *at += 1;
    }
}
