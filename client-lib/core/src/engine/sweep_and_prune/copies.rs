//! The engine's own copy of the boxes, and from there into the order of the sweep: by one thread, since others would wait
//! for what lies in its caches. With two, frames of 20,000 boxes took .9 of their time where the caches of both are near
//! each other, and 1.4 times as long where they are far.

use crate::aabb::{Aabb, order_key};
use crate::aligned::AlignedBuffer;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::strips::{KeyArraysMut, split_keys};
use crate::engine::{AvailableIsa, Census, ingest};
use crate::simd::per_isa;

/// Boxes whose keys are made together: 6 KiB, which stay in the first-level cache.
const BLOCK: usize = 256;
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
        let (mut census, mut pace) = (Census::default(), Pace::default());
        let mut keys = [[0; BLOCK]; 6];
        let copies = self.boxes[..boxes.len()].chunks_mut(BLOCK);
        let copies = copies.zip(self.mins.as_mut_slice().chunks_mut(BLOCK));
        let firsts = (0u32..).step_by(BLOCK);
        for ((boxes, (copies, mins)), first) in boxes.chunks(BLOCK).zip(copies).zip(firsts) {
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

    /// Keys of the min coordinates on the axis, those of what overlaps nothing behind all others.
    pub fn mins(&self) -> &[i32] {
        self.mins.as_slice()
    }

    /// The keys of each position's box, whose index `order` holds, unless cancelled.
    pub fn gather(
        &self,
        order: &[u32],
        mut keys: KeyArraysMut<'_>,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) {
        let mut pace = Pace::default();
        for order in order.chunks(BLOCK) {
            if cancel.look_after(BOX_TESTS * BLOCK as u64, &mut pace) {
                break;
            }
            let (mut block, later) = split_keys(keys, order.len());
            gather_block(&self.boxes, order, &mut block, isa);
            keys = later;
        }
    }

    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.mins.allocated_bytes()
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
