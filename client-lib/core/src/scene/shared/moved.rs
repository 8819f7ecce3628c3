//! Which boxes moved at which tick, for [`Report::Moved`](crate::scene::Report::Moved) over several ticks.

use crate::scene::copy::SceneCopy;
use crate::scene::edit::Edit;
use crate::scene::pair_list::Pair;

/// The last tick at which the box of each index moved, that is, at which an edit named it; 8 bytes an index.
#[derive(Debug, Default)]
pub struct MovedBoxes {
    /// Ticks count from 1: 0 is never.
    ticks: Vec<u64>,
    /// The last tick, and the indices that moved at it.
    last: u64,
    of_last: Vec<u32>,
}

impl MovedBoxes {
    /// Notes all edits of a tick, which were checked against the copy and are not applied to it yet.
    pub fn note(&mut self, tick: u64, edit: Edit<'_>, copy: &SceneCopy) {
        let Self { ticks, last, of_last } = self;
        *last = tick;
        of_last.clear();
        ticks.resize(copy.index_end().max(ticks.len()), 0);
        copy.for_each_named(edit, |index| {
            // A listed pair may name an index beyond all boxes.
            if let Some(moved) = ticks.get_mut(index as usize).filter(|moved| **moved != tick) {
                *moved = tick;
                of_last.push(index);
            }
        });
    }

    /// The indices that moved after a tick, each once. The box may have been removed since.
    pub fn after(&self, tick: u64) -> Vec<u32> {
        if tick.checked_add(1) == Some(self.last) {
            return self.of_last.clone();
        }
        (0..).zip(&self.ticks).filter(|(_, moved)| **moved > tick).map(|(index, _)| index).collect()
    }

    /// Whether a box of a pair moved after a tick.
    pub fn has_moved(&self, pair: Pair, tick: u64) -> bool {
        pair.iter().any(|index| self.ticks.get(*index as usize).is_some_and(|moved| *moved > tick))
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.ticks.capacity() * size_of::<u64>() + self.of_last.capacity() * size_of::<u32>()
    }
}
