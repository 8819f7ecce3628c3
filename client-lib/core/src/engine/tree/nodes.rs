//! Bounds of the groups: of each 16 boxes in order, of each 16 of those, and so on.

use super::FAN_OUT;
use super::arrange::{Entry, TASK_BOXES};
use crate::aabb::KeyBox;
use crate::aligned::AlignedBuffer;
use crate::engine::ingest::split_columns;
use crate::engine::strips::{KeyArraysMut, OrderedBoxes, split_keys};
use crate::team::{Split, in_parts, part_count};

/// The groups of one size, in order.
#[derive(Default)]
pub(super) struct Level {
    /// Six keys of each, in wire order, one array a coordinate.
    keys: AlignedBuffer<i32>,
    /// Of an array: a multiple of [`FAN_OUT`], filled up with what meets nothing.
    stride: usize,
}

impl Level {
    fn resize(&mut self, len: usize) {
        self.stride = len.next_multiple_of(FAN_OUT);
        self.keys.resize(6 * self.stride);
        for (array, nothing) in self.arrays_mut().into_iter().zip(NOTHING) {
            array[len..].fill(nothing);
        }
    }

    /// One array a coordinate.
    pub fn arrays(&self) -> [&[i32]; 6] {
        let keys = self.keys.as_slice();
        std::array::from_fn(|component| &keys[component * self.stride..][..self.stride])
    }

    fn arrays_mut(&mut self) -> KeyArraysMut<'_> {
        split_columns(self.keys.as_mut_slice(), self.stride)
    }

    /// Becomes some groups of another level.
    pub fn gather(&mut self, of: &Self, groups: &[u32]) {
        self.resize(groups.len());
        for (array, from) in self.arrays_mut().into_iter().zip(of.arrays()) {
            for (key, group) in array.iter_mut().zip(groups) {
                *key = from[*group as usize];
            }
        }
    }

    pub fn allocated_bytes(&self) -> usize {
        self.keys.allocated_bytes()
    }

    /// The keys of a group.
    pub fn key(&self, group: u32) -> [i32; 6] {
        self.arrays().map(|array| array[group as usize])
    }
}

/// The keys of what meets nothing, in wire order.
const NOTHING: [i32; 6] = {
    let KeyBox { min, max } = KeyBox::NOTHING;
    [min[0], min[1], min[2], max[0], max[1], max[2]]
};

/// All levels of groups. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct Nodes {
    levels: Vec<Level>,
    used: usize,
}

impl Nodes {
    /// Levels, the one of 16 boxes a group first; the last has 16 groups or fewer.
    pub fn levels(&self) -> &[Level] {
        &self.levels[..self.used]
    }

    pub fn allocated_bytes(&self) -> usize {
        self.levels.iter().map(Level::allocated_bytes).sum()
    }

    /// Writes boxes in their order, and finds the bounds of all groups.
    pub fn build(&mut self, entries: &[Entry], boxes: &mut OrderedBoxes, threads: usize) {
        self.used = 0;
        let mut len = entries.len();
        while self.used == 0 || len > FAN_OUT {
            len = len.div_ceil(FAN_OUT);
            if self.used == self.levels.len() {
                self.levels.push(Level::default());
            }
            self.levels[self.used].resize(len);
            self.used += 1;
        }
        let (keys, order) = boxes.parts_mut();
        let bounds = self.levels[0].arrays_mut();
        let work = Groups { entries, keys, order, bounds };
        let parts = part_count(work.len(), TASK_BOXES / FAN_OUT, threads);
        in_parts(work, parts, &Groups::fill, &|(), ()| ());
        for at in 1..self.used {
            let (below, above) = self.levels.split_at_mut(at);
            let below = below[at - 1].arrays();
            for (component, array) in above[0].arrays_mut().into_iter().enumerate() {
                for (key, of) in array.iter_mut().zip(below[component].chunks_exact(FAN_OUT)) {
                    *key = bound(component, of);
                }
            }
        }
    }
}

/// The bound of some keys of a component: the least of mins, the largest of maxes.
#[inline(always)]
fn bound(component: usize, keys: &[i32]) -> i32 {
    if component < 3 {
        keys.iter().fold(i32::MAX, |a, b| a.min(*b))
    } else {
        keys.iter().fold(i32::MIN, |a, b| a.max(*b))
    }
}

/// Some groups of boxes, and where their keys, indices and bounds go.
struct Groups<'a> {
    entries: &'a [Entry],
    keys: KeyArraysMut<'a>,
    order: &'a mut [u32],
    bounds: KeyArraysMut<'a>,
}

impl Split for Groups<'_> {
    fn len(&self) -> usize {
        self.entries.len().div_ceil(FAN_OUT)
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        let first = at * FAN_OUT;
        let (entries, later_entries) = self.entries.split_at(first);
        let (order, later_order) = self.order.split_at_mut(first);
        let (keys, later_keys) = split_keys(self.keys, first);
        let (bounds, later_bounds) = split_keys(self.bounds, at);
        let later = Self {
            entries: later_entries,
            keys: later_keys,
            order: later_order,
            bounds: later_bounds,
        };
        (Self { entries, keys, order, bounds }, later)
    }
}

impl Groups<'_> {
    fn fill(self) {
        let Self { entries, keys, order, bounds } = self;
        for (group, some) in entries.chunks(FAN_OUT).enumerate() {
            let first = group * FAN_OUT;
            for (at, entry) in (first..).zip(some) {
                let KeyBox { min, max } = KeyBox::from(&entry.aabb);
                for axis in 0..3 {
                    (keys[axis][at], keys[3 + axis][at]) = (min[axis], max[axis]);
                }
                order[at] = entry.index;
            }
            for component in 0..6 {
                let of = &keys[component][first..first + some.len()];
                bounds[component][group] = bound(component, of);
            }
        }
    }
}
