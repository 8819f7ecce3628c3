//! One task's rows, against the groups behind them that their bounds meet.

use std::ops::Range;

use super::FAN_OUT;
use super::nodes::{Level, Nodes};
use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, StripTask};
use crate::simd::per_isa;

/// Levels of the tree are so many bits of a group's number apart.
const FAN_OUT_BITS: usize = FAN_OUT.ilog2() as usize;

/// What a task has met. Memory is kept from frame to frame.
#[derive(Default)]
pub struct Lists {
    /// Groups of a level that the rows' bounds meet, by number.
    met: Vec<u32>,
    /// The same of the level below.
    below: Vec<u32>,
    /// Bounds of the groups of 16 boxes that the rows' bounds meet, side by side.
    near: Level,
    /// Rows, and places of those among them that a row meets.
    of_rows: Vec<[u32; 2]>,
}

impl Lists {
    pub fn allocated_bytes(&self) -> usize {
        let numbers = self.met.capacity() + self.below.capacity() + 2 * self.of_rows.capacity();
        numbers * size_of::<u32>() + self.near.allocated_bytes()
    }
}

impl StripTask<Lists> {
    /// Finds the words of all rows, which begin with a group of 16, until the budget is spent. Boxes from
    /// position `valid` on overlap nothing.
    pub(super) fn search(
        &mut self,
        boxes: &OrderedBoxes,
        nodes: &Nodes,
        valid: u32,
        gather: &Gather<'_>,
    ) {
        self.begin();
        let mut lists = std::mem::take(&mut self.own);
        for first in self.rows.clone().step_by(FAN_OUT) {
            if gather.budget.is_spent() {
                break;
            }
            self.search_group(&mut lists, boxes, nodes, [first, valid], gather);
        }
        self.own = lists;
        self.finish(boxes, gather);
    }

    fn search_group(
        &mut self,
        lists: &mut Lists,
        boxes: &OrderedBoxes,
        nodes: &Nodes,
        [first, valid]: [u32; 2],
        gather: &Gather<'_>,
    ) {
        let Lists { met, below, near, of_rows } = lists;
        let (isa, levels, group) = (gather.isa, nodes.levels(), first / FAN_OUT as u32);
        let bounds = levels[0].key(group);
        // From the whole down to the groups of 16 boxes, which each row looks at by itself.
        met.clear();
        met.push(0);
        for (depth, level) in levels.iter().enumerate().rev() {
            let own = if depth == 0 { group + 1 } else { group >> (FAN_OUT_BITS * depth) };
            below.clear();
            meeting(&level.arrays(), &bounds, met, own, below, isa);
            std::mem::swap(met, below);
        }
        near.gather(&levels[0], met);
        let keys = boxes.keys();
        let end = valid.min(first + FAN_OUT as u32);
        of_rows.clear();
        if !met.is_empty() {
            rows_meeting(&keys, first..end, &near.arrays(), of_rows, isa);
        }
        let mut next = of_rows.iter().peekable();
        let mut push = |row: u32, start: u32, end: u32| {
            if self.batch.room() == 0 {
                self.flush(boxes, gather);
            }
            self.batch.push(row, start, end);
        };
        for row in first..end {
            push(row, row + 1, end);
            while let Some([_, slot]) = next.next_if(|[of, _]| *of == row) {
                let start = met[*slot as usize] * FAN_OUT as u32;
                push(row, start, valid.min(start + FAN_OUT as u32));
            }
        }
    }
}

per_isa! {
    /// Adds the rows, and the places of the groups around them that each meets.
    fn rows_meeting<simd: S>(
        keys: &[&[i32]; 6],
        rows: Range<u32>,
        near: &[&[i32]; 6],
        met: &mut Vec<[u32; 2]>,
    ) {
        for row in rows {
            let mut own = [simd.splat(0); 6];
            for (own, keys) in own.iter_mut().zip(keys) {
                *own = simd.splat(keys[row as usize]);
            }
            for first in (0..near[0].len()).step_by(S::LANES) {
                let mut bits = {
                    let mut met = simd.all_meet();
                    for axis in 0..3 {
                        let mins = simd.load(&near[axis][first..]);
                        let maxes = simd.load(&near[3 + axis][first..]);
                        met = simd.meet(met, [mins, maxes], [own[axis], own[3 + axis]]);
                    }
                    simd.met_bits(met)
                };
                while bits != 0 {
                    met.push([row, first as u32 + bits.trailing_zeros()]);
                    bits &= bits - 1;
                }
            }
        }
    }
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
