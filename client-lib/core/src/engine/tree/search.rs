//! One task's rows, against the groups behind them that their bounds meet.

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
    /// Places of those among them that a row meets.
    of_row: Vec<u32>,
    /// The numbers from 0 on.
    numbers: Vec<u32>,
}

impl Lists {
    pub fn allocated_bytes(&self) -> usize {
        let lists = [&self.met, &self.below, &self.of_row, &self.numbers].map(Vec::capacity);
        lists.iter().sum::<usize>() * size_of::<u32>() + self.near.allocated_bytes()
    }
}

impl StripTask<Lists> {
    /// Finds the words of all rows, which begin with a group of 16, until the budget is spent. Boxes from
    /// position `solid` on overlap nothing.
    pub(super) fn search(
        &mut self,
        boxes: &OrderedBoxes,
        nodes: &Nodes,
        solid: u32,
        gather: &Gather<'_>,
    ) {
        self.begin();
        let mut lists = std::mem::take(&mut self.own);
        for first in self.rows.clone().step_by(FAN_OUT) {
            if gather.budget.is_spent() {
                break;
            }
            self.search_group(&mut lists, boxes, nodes, [first, solid], gather);
        }
        self.own = lists;
        self.finish(boxes, gather);
    }

    fn search_group(
        &mut self,
        lists: &mut Lists,
        boxes: &OrderedBoxes,
        nodes: &Nodes,
        [first, solid]: [u32; 2],
        gather: &Gather<'_>,
    ) {
        let Lists { met, below, near, of_row, numbers } = lists;
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
        let strips = met.len().div_ceil(FAN_OUT);
        numbers.extend(numbers.len() as u32..strips as u32);
        let (keys, near) = (boxes.keys(), near.arrays());
        let end = solid.min(first + FAN_OUT as u32);
        for row in first..end {
            let key: [i32; 6] = std::array::from_fn(|component| keys[component][row as usize]);
            of_row.clear();
            meeting(&near, &key, &numbers[..strips], 0, of_row, isa);
            let mut push = |start: u32, end: u32| {
                if self.batch.room() == 0 {
                    self.flush(boxes, gather);
                }
                self.batch.push(row, start, end);
            };
            push(row + 1, end);
            for place in &*of_row {
                let start = met[*place as usize] * FAN_OUT as u32;
                push(start, solid.min(start + FAN_OUT as u32));
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
