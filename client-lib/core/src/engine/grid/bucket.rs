//! Second pass: each bucket collects its boxes from all tiles and sorts them by cell.

use super::fetch::fetch;
use super::homes::CELL_MASK;
use super::level::Reach;
use super::sort::Deal;
use super::tile::Record;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::AvailableIsa;
use crate::engine::strips::{KeyArraysMut, split_keys};
use crate::team::{Split, in_parts, part_count};

/// A range of buckets, and the stretch of every output that is theirs.
pub(super) struct Buckets<'a> {
    pub first_bucket: usize,
    pub first_position: u32,
    /// First position of every bucket of the range, and the end of the last one.
    pub starts: &'a [u32],
    pub keys: KeyArraysMut<'a>,
    pub order: &'a mut [u32],
    pub reach: &'a mut [Reach],
    pub cell_ends: &'a mut [u32],
    pub deal: Deal,
    pub isa: AvailableIsa,
}

impl Split for Buckets<'_> {
    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let position = self.starts[at];
        let boxes = (position - self.first_position) as usize;
        let cells = self.cell_ends.len().min(at << self.deal.bucket_shift);
        let (order, later_order) = self.order.split_at_mut(boxes);
        let (reach, later_reach) = self.reach.split_at_mut(boxes);
        let (cell_ends, later_cell_ends) = self.cell_ends.split_at_mut(cells);
        let (keys, later_keys) = split_keys(self.keys, boxes);
        let later = Self {
            first_bucket: self.first_bucket + at,
            first_position: position,
            starts: &self.starts[at..],
            keys: later_keys,
            order: later_order,
            reach: later_reach,
            cell_ends: later_cell_ends,
            deal: self.deal,
            isa: self.isa,
        };
        let starts = &self.starts[..=at];
        (Self { starts, keys, order, reach, cell_ends, ..self }, later)
    }
}

impl Buckets<'_> {
    /// Sorts all buckets, unless cancelled. `records` and `ends` are what the first pass left.
    pub fn run(self, records: &[Record], ends: &[u32], cancel: &Cancel) {
        let parts = part_count(self.len(), 1, self.deal.threads);
        let collect = |buckets: Buckets<'_>| {
            let (mut rest, mut pace) = (buckets, Pace::default());
            while rest.len() > 1 {
                let boxes = rest.starts[1] - rest.starts[0];
                if cancel.look_after(BOX_TESTS * u64::from(boxes), &mut pace) {
                    return;
                }
                let (first, later) = rest.split_at(1);
                first.sort_one(records, ends);
                rest = later;
            }
            rest.sort_one(records, ends);
        };
        in_parts(self, parts, &collect, &|(), ()| ());
    }

    /// The range is one bucket: counts its cells, finds each box's position, and fetches the boxes.
    fn sort_one(mut self, records: &[Record], ends: &[u32]) {
        let first_cell = (self.first_bucket as u32) << self.deal.bucket_shift;
        let cell_ends = &mut *self.cell_ends;
        cell_ends.fill(0);
        let segments = || segments(records, ends, self.first_bucket, self.deal);
        for (_, records) in segments() {
            for record in records {
                cell_ends[((record.home & CELL_MASK) - first_cell) as usize] += 1;
            }
        }
        let mut start = 0;
        for cell in cell_ends.iter_mut() {
            let count = *cell;
            *cell = start;
            start += count;
        }
        // Until the boxes are fetched, `order` holds the number of each position's record.
        for (first_record, records) in segments() {
            for (record, source) in records.iter().zip(first_record..) {
                // Rises from the cell's first position to its end.
                let next = &mut cell_ends[((record.home & CELL_MASK) - first_cell) as usize];
                self.order[*next as usize] = source;
                *next += 1;
            }
        }
        for end in cell_ends.iter_mut() {
            *end += self.first_position;
        }
        fetch(records, &mut self.keys, self.order, self.reach, self.isa);
    }
}

/// A bucket's records of each tile and the number of the first one, in the order of the tiles.
fn segments<'a>(
    records: &'a [Record],
    ends: &'a [u32],
    bucket: usize,
    deal: Deal,
) -> impl Iterator<Item = (u32, &'a [Record])> {
    let tiles = records.chunks(deal.tile_len).zip(ends.chunks_exact(deal.bucket_count));
    tiles.zip((0..).step_by(deal.tile_len)).map(move |((records, ends), first)| {
        let start = if bucket == 0 { 0 } else { ends[bucket - 1] };
        (first + start, &records[start as usize..ends[bucket] as usize])
    })
}
