//! The engine's own copy of the boxes, and from there into the order of the sweep.

use crate::aabb::{Aabb, order_key};
use crate::aligned::AlignedBuffer;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::strips::{KeyArraysMut, split_keys};
use crate::engine::{AvailableIsa, Census, ingest};
use crate::simd::per_isa;
use crate::team::{Split, in_parts, part_count};

/// Boxes whose keys are made together: 6 KiB, which stay in the first-level cache.
const BLOCK: usize = 256;
/// Blocks that are worth a part of their own: 10 to 20 µs.
const BLOCKS_LEAST: usize = 16;
/// Words that are read of a box: two more than it has, which are those of the next one.
const READ: usize = 8;

/// Copies of the boxes. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct Copies {
    /// One more than there are boxes, so that [`READ`] words of the last one can be read.
    boxes: Vec<Aabb>,
    /// Keys of the min coordinates on the axis.
    mins: AlignedBuffer<i32>,
}

impl Copies {
    /// Copies the boxes, each of which is read once, and counts those that overlap nothing, unless cancelled.
    pub fn make(
        &mut self,
        boxes: &[Aabb],
        axis: usize,
        threads: usize,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Census {
        let room = boxes.len() + 1;
        if self.boxes.capacity() < room {
            // The old ones are not worth copying, and the two need not stand in memory together.
            self.boxes = Vec::new();
            self.boxes.reserve_exact(room);
        }
        self.boxes.resize(room, Aabb::EMPTY);
        self.mins.resize(boxes.len());
        let (copies, mins) = (&mut self.boxes[..boxes.len()], self.mins.as_mut_slice());
        let work = Sources { boxes, first: 0, copies, mins };
        let parts = part_count(work.len(), BLOCKS_LEAST, threads);
        in_parts(work, parts, &|some: Sources<'_>| some.copy(axis, isa, cancel), &|low, high| {
            low.then(&high)
        })
    }

    /// Keys of the min coordinates on the axis, those of what overlaps nothing behind all others.
    pub fn mins(&self) -> &[i32] {
        self.mins.as_slice()
    }

    /// The keys of each position's box, whose index `order` holds, unless cancelled.
    pub fn gather(
        &self,
        order: &[u32],
        keys: KeyArraysMut<'_>,
        threads: usize,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) {
        let work = Positions { order, keys };
        let parts = part_count(work.len(), BLOCKS_LEAST, threads);
        let gather_some = |some: Positions<'_>| {
            let (mut rest, mut pace) = (some, Pace::default());
            while rest.len() > 0 && !cancel.look_after(BOX_TESTS * BLOCK as u64, &mut pace) {
                let (mut block, later) = rest.split_at(1);
                gather_block(&self.boxes, block.order, &mut block.keys, isa);
                rest = later;
            }
        };
        in_parts(work, parts, &gather_some, &|(), ()| ());
    }

    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.mins.allocated_bytes()
    }
}

/// A range of boxes, and room for their copies, in blocks.
struct Sources<'a> {
    boxes: &'a [Aabb],
    /// Index of the first one.
    first: usize,
    copies: &'a mut [Aabb],
    mins: &'a mut [i32],
}

impl Split for Sources<'_> {
    fn len(&self) -> usize {
        self.boxes.len().div_ceil(BLOCK)
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let at = self.boxes.len().min(at * BLOCK);
        let (boxes, later_boxes) = self.boxes.split_at(at);
        let (copies, later_copies) = self.copies.split_at_mut(at);
        let (mins, later_mins) = self.mins.split_at_mut(at);
        let later = Self {
            boxes: later_boxes,
            first: self.first + at,
            copies: later_copies,
            mins: later_mins,
        };
        (Self { boxes, first: self.first, copies, mins }, later)
    }
}

impl Sources<'_> {
    fn copy(self, axis: usize, isa: AvailableIsa, cancel: &Cancel) -> Census {
        let (mut census, mut pace) = (Census::default(), Pace::default());
        let mut keys = [[0; BLOCK]; 6];
        let copies = self.copies.chunks_mut(BLOCK).zip(self.mins.chunks_mut(BLOCK));
        let firsts = (self.first as u32..).step_by(BLOCK);
        for ((boxes, (copies, mins)), first) in self.boxes.chunks(BLOCK).zip(copies).zip(firsts) {
            if cancel.look_after(BOX_TESTS * BLOCK as u64, &mut pace) {
                break;
            }
            copies.copy_from_slice(boxes);
            let mut keys = keys.each_mut().map(|keys| &mut keys[..boxes.len()]);
            let mut found = Census::default();
            ingest::fill(copies, &mut keys, &mut found, isa);
            mins.copy_from_slice(keys[axis]);
            census = census.then(&found.behind(first));
        }
        census
    }
}

/// A range of positions in the order of the sweep, in blocks.
struct Positions<'a> {
    order: &'a [u32],
    keys: KeyArraysMut<'a>,
}

impl Split for Positions<'_> {
    fn len(&self) -> usize {
        self.order.len().div_ceil(BLOCK)
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let at = self.order.len().min(at * BLOCK);
        let (order, later_order) = self.order.split_at(at);
        let (keys, later_keys) = split_keys(self.keys, at);
        (Self { order, keys }, Self { order: later_order, keys: later_keys })
    }
}

per_isa! {
    /// The keys of each position's box, whose index `order` holds. Behind the last box stands one more, whose words
    /// are read and not used.
    fn gather_block<simd: S>(boxes: &[Aabb], order: &[u32], keys: &mut KeyArraysMut<'_>) {
        let words: &[i32] = bytemuck::cast_slice(boxes);
        let whole = order.len() / S::LANES * S::LANES;
        for first in (0..whole).step_by(S::LANES) {
            let order = &order[first..first + S::LANES];
            let [coordinates @ .., _, _] = simd.words_of(|i| {
                let at = 6 * order[i] as usize;
                &words[at..at + READ].as_chunks::<READ>().0[0]
            });
            for (array, bits) in keys.iter_mut().zip::<[S::Keys; 6]>(coordinates) {
                simd.store(simd.order_keys(bits), &mut array[first..first + S::LANES]);
            }
        }
        for at in whole..order.len() {
            let coordinates: &[u32; 6] = bytemuck::cast_ref(&boxes[order[at] as usize]);
            for (array, bits) in keys.iter_mut().zip(coordinates) {
                array[at] = order_key(*bits);
            }
        }
    }
}
