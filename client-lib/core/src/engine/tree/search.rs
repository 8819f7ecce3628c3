//! One task's rows, against the groups behind them that their bounds meet.

use std::ops::Range;

use super::FAN_OUT;
use super::nodes::{Level, Nodes};
use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, StripBatch, WordSink};
use crate::simd::per_isa;

/// Levels of the tree are so many bits of a group's number apart.
const FAN_OUT_BITS: usize = FAN_OUT.ilog2() as usize;

/// A range of groups of 16 rows, and what was found in them. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct SearchTask {
    pub groups: Range<u32>,
    pub found: WordSink,
    pub compared: u64,
    batch: StripBatch,
    /// Groups of a level that the rows' bounds meet, by number.
    met: Vec<u32>,
    /// The same of the level below.
    below: Vec<u32>,
    /// Bounds of the groups of 16 boxes that the rows' bounds meet, side by side.
    near: Level,
    /// Places of those among them that a row meets.
    of_row: Vec<u32>,
    /// The numbers from 0 on.
    numbers: Vec<u32>,
}

impl SearchTask {
    pub fn allocated_bytes(&self) -> usize {
        let lists = [&self.met, &self.below, &self.of_row, &self.numbers].map(Vec::capacity);
        let lists = lists.iter().sum::<usize>() * size_of::<u32>();
        let bounds = self.near.allocated_bytes();
        self.found.allocated_bytes() + self.batch.allocated_bytes() + lists + bounds
    }

    /// Finds the words of all rows, until the budget is spent. Boxes from position `solid` on overlap
    /// nothing.
    pub fn run(&mut self, boxes: &OrderedBoxes, nodes: &Nodes, solid: u32, gather: &Gather<'_>) {
        self.found.clear();
        self.batch.reset();
        for group in self.groups.clone() {
            if gather.budget.is_spent() {
                return;
            }
            self.run_group(boxes, nodes, solid, group, gather);
        }
        flush(&mut self.batch, &mut self.found, boxes, gather);
        self.found.finish(gather);
        self.compared = self.batch.take_compared();
    }

    fn run_group(
        &mut self,
        boxes: &OrderedBoxes,
        nodes: &Nodes,
        solid: u32,
        group: u32,
        gather: &Gather<'_>,
    ) {
        let (isa, levels) = (gather.isa, nodes.levels());
        let bounds = levels[0].key(group);
        // From the whole down to the groups of 16 boxes, which each row looks at by itself.
        self.met.clear();
        self.met.push(0);
        for (depth, level) in levels.iter().enumerate().rev() {
            let own = if depth == 0 { group + 1 } else { group >> (FAN_OUT_BITS * depth) };
            self.below.clear();
            meeting(&level.arrays(), &bounds, &self.met, own, &mut self.below, isa);
            std::mem::swap(&mut self.met, &mut self.below);
        }
        self.near.gather(&levels[0], &self.met);
        let strips = self.met.len().div_ceil(FAN_OUT);
        self.numbers.extend(self.numbers.len() as u32..strips as u32);
        let Self { near, met, of_row, numbers, batch, found, .. } = self;
        let (keys, near) = (boxes.keys(), near.arrays());
        let first = group * FAN_OUT as u32;
        let end = solid.min(first + FAN_OUT as u32);
        for row in first..end {
            let key: [i32; 6] = std::array::from_fn(|component| keys[component][row as usize]);
            of_row.clear();
            meeting(&near, &key, &numbers[..strips], 0, of_row, isa);
            let mut push = |start: u32, end: u32| {
                if batch.room() == 0 {
                    flush(batch, found, boxes, gather);
                }
                batch.push(row, start, end);
            };
            push(row + 1, end);
            for place in &*of_row {
                let start = met[*place as usize] * FAN_OUT as u32;
                push(start, solid.min(start + FAN_OUT as u32));
            }
        }
    }
}

fn flush(batch: &mut StripBatch, found: &mut WordSink, boxes: &OrderedBoxes, gather: &Gather<'_>) {
    batch.test(boxes, gather.isa);
    found.take(batch, gather);
    batch.clear();
}

per_isa! {
    /// Adds the children of some groups that a box meets, from number `from` on. `keys` are those of all
    /// children.
    fn meeting<simd: S>(
        keys: &[&[i32]; 6],
        of: &[i32; 6],
        groups: &[u32],
        from: u32,
        met: &mut Vec<u32>,
    ) {
        let mut own = [simd.splat(0); 6];
        for (own, key) in own.iter_mut().zip(of) {
            *own = simd.splat(*key);
        }
        for group in groups {
            let first = *group as usize * FAN_OUT;
            let mut bits = 0;
            for lane in (0..FAN_OUT).step_by(S::LANES) {
                let mut met = simd.all_meet();
                for axis in 0..3 {
                    let at = first + lane;
                    let columns = [simd.load(&keys[axis][at..]), simd.load(&keys[3 + axis][at..])];
                    met = simd.meet(met, columns, [own[axis], own[3 + axis]]);
                }
                bits |= simd.met_bits(met) << lane;
            }
            let first = first as u32;
            while bits != 0 {
                let child = first + bits.trailing_zeros();
                bits &= bits - 1;
                if child >= from {
                    met.push(child);
                }
            }
        }
    }
}
