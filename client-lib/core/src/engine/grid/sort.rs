//! Boxes into the order of their cells, in two passes that never leave the second-level cache.
//!
//! A scene of a million boxes is larger than the caches and shuffled, so that fetching boxes by
//! index costs a miss each (20 ms in a prototype). Instead each tile of the input, read once and in
//! sequence, is dealt into buckets of neighbouring cells within the tile's own stretch of records
//! ([`super::tile`]); then each bucket collects its boxes from all tiles and sorts them by cell, by
//! counting ([`super::bucket`]). Both passes are stable, so that boxes of one cell stand by index,
//! regardless of the tiles and threads.

use super::bucket::Buckets;
use super::level::{Level, Reach};
use super::tile::{Record, Tiles};
use crate::aabb::Aabb;
use crate::aligned::AlignedBuffer;
use crate::cancel::Cancel;
use crate::engine::strips::OrderedBoxes;
use crate::engine::{AvailableIsa, Census, CullError};

/// Most boxes of a tile: 384 KiB of boxes and 512 KiB of records. Larger tiles leave longer stretches
/// to each bucket, which the second pass reads faster.
pub(super) const TILE_MOST: usize = 16_384;
/// Fewest boxes of a tile, so that the buckets' counters do not outweigh them.
const TILE_LEAST: usize = 512;
/// Boxes a bucket, about: as many as keep the passes over it in the second-level cache.
const BUCKET_BOXES: usize = 2_048;
/// Most boxes that one thread leaves in one bucket: 384 KiB of records, which stay in the
/// second-level cache beside the keys. Several threads share the buckets out.
const UNDEALT_MOST: usize = 12_288;
/// Most buckets: half as many lines as the first-level cache holds, since each is open for writing.
pub(super) const BUCKET_MOST: usize = 512;

/// Boxes sorted by cell. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct SortedBoxes {
    /// Keys and indices by position.
    pub boxes: OrderedBoxes,
    /// Reach of the box at each position.
    pub reach: Vec<Reach>,
    /// First position of each cell; then that of the boxes that overlap nothing; then n.
    pub cell_starts: Vec<u32>,
    records: AlignedBuffer<Record>,
    /// Of each tile, where each bucket ends within the tile.
    bucket_ends: Vec<u32>,
    /// First position of each bucket, and n.
    bucket_starts: Vec<u32>,
}

/// How the boxes are shared among tiles and the cells among buckets.
#[derive(Clone, Copy)]
pub(super) struct Deal {
    /// Boxes of every tile but the last.
    pub tile_len: usize,
    /// At most [`BUCKET_MOST`].
    pub bucket_count: usize,
    /// Cell number to bucket.
    pub bucket_shift: u32,
    /// Threads that may be used.
    pub threads: usize,
}

impl Deal {
    fn new(n: usize, cells: usize, threads: usize) -> Self {
        let tile_len = n.div_ceil(4 * threads.max(1)).clamp(TILE_LEAST, TILE_MOST);
        let undealt = threads <= 1 && n <= UNDEALT_MOST;
        let requested = if undealt { 1 } else { (n / BUCKET_BOXES).clamp(1, BUCKET_MOST) };
        let bucket_shift = cells.div_ceil(requested).next_power_of_two().trailing_zeros();
        Self { tile_len, bucket_count: ((cells - 1) >> bucket_shift) + 1, bucket_shift, threads }
    }
}

impl SortedBoxes {
    /// Sorts the boxes of a frame and counts those that overlap nothing.
    ///
    /// # Errors
    /// [`CullError::Cancelled`].
    pub fn sort(
        &mut self,
        boxes: &[Aabb],
        levels: &[Level],
        cell_count: u32,
        threads: usize,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError> {
        let n = boxes.len();
        // One cell more for the boxes that overlap nothing.
        let cells = cell_count as usize + 1;
        let deal = Deal::new(n, cells, threads);
        self.records.resize(n);
        self.bucket_ends.clear();
        self.bucket_ends.resize(n.div_ceil(deal.tile_len) * deal.bucket_count, 0);
        let records = self.records.as_mut_slice();
        let ends = self.bucket_ends.as_mut_slice();
        let tiles = Tiles { boxes, first_index: 0, records, ends, deal };
        let census = tiles.run(levels, cell_count, isa, cancel);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }

        self.boxes.resize(n);
        self.reach.resize(n, 0);
        self.cell_starts.resize(cells + 1, 0);
        self.start_buckets(deal);
        let (keys, order) = self.boxes.parts_mut();
        Buckets {
            first_bucket: 0,
            first_position: 0,
            starts: &self.bucket_starts,
            keys,
            order,
            reach: &mut self.reach,
            cell_ends: &mut self.cell_starts[1..],
            deal,
            isa,
        }
        .run(self.records.as_slice(), &self.bucket_ends, cancel);
        if cancel.is_cancelled() { Err(CullError::Cancelled) } else { Ok(census) }
    }

    pub fn allocated_bytes(&self) -> usize {
        let words = self.cell_starts.capacity()
            + self.bucket_ends.capacity()
            + self.bucket_starts.capacity();
        self.boxes.allocated_bytes()
            + self.reach.capacity() * size_of::<Reach>()
            + words * size_of::<u32>()
            + self.records.allocated_bytes()
    }

    /// First position of each bucket, from the tiles' counts.
    fn start_buckets(&mut self, deal: Deal) {
        self.bucket_starts.clear();
        self.bucket_starts.resize(deal.bucket_count + 1, 0);
        for ends in self.bucket_ends.chunks_exact(deal.bucket_count) {
            let mut start = 0;
            for (count, end) in self.bucket_starts.iter_mut().zip(ends) {
                *count += end - start;
                start = *end;
            }
        }
        let mut start = 0;
        for count in &mut self.bucket_starts {
            let end = start + *count;
            *count = start;
            start = end;
        }
    }
}
