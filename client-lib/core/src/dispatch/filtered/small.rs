//! Small worlds: many of them at a time, each row against the boxes of its world that come after it.
//!
//! Their boxes lie one world after the other, so that reading them, laying out their rules and collecting
//! words cost a box, not a world.

use super::laid::Laid;
use super::look::Look;
use super::test::{FilterTest, Indices};
use crate::aabb::Aabb;
use crate::engine::encode::FoundWords;
use crate::engine::gather::Gather;
use crate::engine::strips::{OrderedBoxes, RowBlock, StripTask};
use crate::engine::word_budget::WordBudget;
use crate::engine::{AvailableIsa, Census, CullError, HeapReply, PairRules, ingest};
use crate::filters::Rules;
use crate::mask::Encoding;
use crate::units::BoxCount;

/// Boxes of a world up to which all pairs are tested: to sort them takes longer.
pub const SMALL_BOXES: usize = 384;
/// Boxes of a batch from which it is culled: its keys stay in a core's second cache.
pub const BATCH_BOXES: usize = 4_096;

/// One world of a batch.
#[derive(Clone, Copy, Debug)]
struct Small {
    /// The end of its own boxes, each of which is a row.
    own_end: u32,
    /// The end of its boxes, with those of all worlds.
    end: u32,
}

/// A batch of small worlds, and what one thread culls it with.
#[derive(Default)]
pub struct SmallWorlds {
    worlds: Vec<Small>,
    /// The box of each position.
    members: Vec<u32>,
    gathered: Vec<Aabb>,
    boxes: OrderedBoxes,
    task: StripTask,
}

impl SmallWorlds {
    pub fn allocated_bytes(&self) -> usize {
        self.worlds.capacity() * size_of::<Small>()
            + self.members.capacity() * size_of::<u32>()
            + self.gathered.capacity() * size_of::<Aabb>()
            + self.boxes.allocated_bytes()
            + self.task.allocated_bytes()
    }

    /// Boxes of the batch.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Begins a batch.
    pub fn clear(&mut self) {
        self.worlds.clear();
        self.members.clear();
    }

    /// Adds a world: its own boxes, and those of all worlds, which do not meet one another here.
    pub fn add(&mut self, own: &[u32], of_all: &[u32]) {
        self.members.extend_from_slice(own);
        let own_end = self.members.len() as u32;
        self.members.extend_from_slice(of_all);
        self.worlds.push(Small { own_end, end: self.members.len() as u32 });
    }

    /// Adds the pairs of the batch to `pairs`, world by world, and to `counts` how many each world has.
    /// Returns the census of its boxes, and how many pairs were compared.
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        rules: Option<(&Rules, &Look)>,
        isa: AvailableIsa,
        (pairs, counts, laid): (&mut Vec<[u32; 2]>, &mut Vec<usize>, &mut Laid),
    ) -> Result<(Census, u64), CullError> {
        let census = self.ingest(boxes, isa);
        let memory = std::mem::take(laid);
        let test = rules.map(|(rules, look)| {
            FilterTest::new(rules, look, Indices::Of(&self.members, &[]), memory)
        });
        let rules = test.as_ref().map_or(PairRules::NONE, |test| PairRules::tested_by(test));
        rules.prepare(self.members.len(), &[], 1);
        let n = BoxCount::new(self.members.len() as u32);
        // A batch has few words: what all of them may take is looked at by who adds them up.
        let budget = &WordBudget::new(n, Encoding::List, false, &HeapReply::new())?;
        let gather = &Gather { budget, rules, order: &[], isa, keeps: true };
        find(&self.worlds, &self.boxes, &mut self.task, gather);
        if let Some(test) = test {
            *laid = test.into_memory();
        }
        self.name(pairs, counts);
        Ok((census, self.task.compared))
    }

    /// Reads the boxes. Each is read once.
    fn ingest(&mut self, boxes: &[Aabb], isa: AvailableIsa) -> Census {
        let n = self.members.len();
        self.boxes.resize(n);
        let (mut keys, _) = self.boxes.parts_mut();
        let first = self.members.first().map_or(0, |first| *first as usize);
        let is_run = self.members.is_sorted_by(|a, b| b.wrapping_sub(*a) == 1);
        let boxes = match boxes.get(first..first + n) {
            Some(boxes) if is_run => boxes,
            _ => {
                self.gathered.clear();
                self.gathered.extend(self.members.iter().map(|index| boxes[*index as usize]));
                &self.gathered
            }
        };
        let mut census = Census::default();
        ingest::fill(boxes, &mut keys, &mut census, isa);
        census
    }

    /// Names the pairs of all words. Words come by rising row, so that worlds do too.
    fn name(&self, pairs: &mut Vec<[u32; 2]>, counts: &mut Vec<usize>) {
        let mut before = pairs.len();
        let (mut worlds, mut own_end) = (self.worlds.iter(), 0);
        for [rows, blocks, bits] in self.task.found.chunks() {
            for ((row, block), bits) in rows.iter().zip(blocks).zip(bits) {
                while *row >= own_end {
                    // The count of the world before, if there is one.
                    if own_end > 0 {
                        counts.push(pairs.len() - before);
                        before = pairs.len();
                    }
                    match worlds.next() {
                        Some(world) => own_end = world.own_end,
                        None => return,
                    }
                }
                let a = self.members[*row as usize];
                let mut rest = *bits;
                while rest != 0 {
                    let column = 32 * *block as usize + rest.trailing_zeros() as usize;
                    let b = self.members[column];
                    pairs.push([a.min(b), a.max(b)]);
                    rest &= rest - 1;
                }
            }
        }
        let counted = self.worlds.len() - worlds.len();
        if counted > 0 {
            counts.push(pairs.len() - before);
        }
        counts.extend(std::iter::repeat_n(0, worlds.len()));
    }
}

/// Finds the words of all worlds.
fn find(worlds: &[Small], boxes: &OrderedBoxes, task: &mut StripTask, gather: &Gather<'_>) {
    task.begin();
    let takes_blocks = RowBlock::pays(gather.isa);
    let mut start = 0;
    for world in worlds {
        let mut row = start;
        while row < world.own_end {
            let end = RowBlock::border(row).min(world.own_end);
            if takes_blocks && task.block.begin(row..end, world.end) {
                task.flush_block(boxes, gather);
            } else {
                for row in row..end {
                    let mut column = row + 1;
                    while column < world.end {
                        if task.batch.room() == 0 {
                            task.flush(boxes, gather);
                        }
                        column = task.batch.push(row, column, world.end);
                    }
                }
            }
            row = end;
        }
        start = world.end;
    }
    task.finish(boxes, gather);
}
