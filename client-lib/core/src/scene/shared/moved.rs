//! Which boxes moved at which tick, for [`Report::Moved`](crate::scene::Report::Moved) over several ticks, and whose user
//! data changed.

use super::remains::RemainingBoxes;
use crate::scene::copy::SceneCopy;
use crate::scene::edit::Edit;
use crate::scene::pair_list::Pair;

/// The last tick at which something happened to the box of each index; 8 bytes an index, up to the last one.
#[derive(Debug, Default)]
pub struct MovedBoxes {
    /// Ticks count from 1: 0 is never.
    ticks: Vec<u64>,
    /// The last tick, and the indices that it happened to.
    last: u64,
    of_last: Vec<u32>,
}

impl MovedBoxes {
    /// Notes the boxes that the edits of a tick name or remove, which were checked against the copy and are not applied to it
    /// yet.
    pub fn note_named(&mut self, tick: u64, edit: Edit<'_>, copy: &SceneCopy) {
        self.note(tick, copy.index_end(), |f| {
            copy.for_each_named(edit, &mut *f);
            edit.for_each_removed(f);
        });
    }

    /// Notes the boxes whose user data the edits of a tick change, among them boxes that take the index of a removed one,
    /// or of one whose writer has left.
    pub fn note_marked(
        &mut self,
        tick: u64,
        edit: Edit<'_>,
        copy: &SceneCopy,
        remaining: &RemainingBoxes,
    ) {
        if edit.gives_user_data() || !self.ticks.is_empty() {
            self.note(tick, copy.index_end(), |f| {
                edit.for_each_user_data(|index, _| f(index));
                edit.for_each_set(|index, _| {
                    let is_another = copy.is_replaced_by_edit(index) || remaining.has(index);
                    if copy.states().user_data(index) != 0 && is_another {
                        f(index);
                    }
                });
            });
        }
    }

    fn note(&mut self, tick: u64, end: usize, each: impl FnOnce(&mut dyn FnMut(u32))) {
        let Self { ticks, last, of_last } = self;
        if *last != tick {
            *last = tick;
            of_last.clear();
        }
        ticks.resize(end.max(ticks.len()), 0);
        each(&mut |index| {
            // A listed pair may name an index beyond all boxes.
            if let Some(moved) = ticks.get_mut(index as usize).filter(|moved| **moved != tick) {
                *moved = tick;
                of_last.push(index);
            }
        });
    }

    /// The indices that it happened to after a tick, each once. The box may have been removed since.
    pub fn after(&self, tick: u64) -> Vec<u32> {
        if tick >= self.last {
            return Vec::new();
        }
        if tick + 1 == self.last {
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
