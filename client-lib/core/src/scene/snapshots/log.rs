//! What boxes and rules were before they changed.

use std::collections::HashMap;

use super::super::edit::{Edit, Indices, Step};
use super::super::pair_list::Pair;
use super::super::snapshot::BoxSnapshot;
use super::Replicas;
use super::restore::Incarnations;
use crate::aabb::Aabb;
use crate::fetch::ask_for;
use crate::filters::{FilterTable, Listed};

/// A box of the scene, and which one of those that its index has had.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoxRecord {
    pub set: BoxSnapshot,
    pub incarnation: u32,
}

/// An index, and the box that it had; with that as it was sent, where it has a margin.
type Entry = (u32, Option<BoxRecord>);

/// A line of the caches for each box.
const _: () = assert!(size_of::<Entry>() == 64);

/// What of a scene is, or was, another than in a second one: as it is in the first.
#[derive(Clone, Debug, Default)]
pub(super) struct Delta {
    /// By index, each once; `None` where there was no box.
    pub boxes: Vec<Entry>,
    /// Each of them as it was sent; none of a scene without margins.
    pub sent: Vec<Aabb>,
    pub listed: HashMap<Pair, Listed>,
    pub table: Option<FilterTable>,
}

impl Delta {
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.listed.is_empty() && self.table.is_none()
    }

    /// From a first scene by a second to a third: this one leads from the first to the second.
    pub fn then(mut self, later: Self, places: &mut Places) -> Self {
        if self.is_empty() {
            return later;
        }
        places.note_all(&self);
        for (at, entry) in later.boxes.into_iter().enumerate() {
            if places.of(entry.0).is_none() {
                self.boxes.push(entry);
                self.sent.extend(later.sent.get(at));
            }
        }
        for (pair, listed) in later.listed {
            self.listed.entry(pair).or_insert(listed);
        }
        self.table = self.table.or(later.table);
        self
    }

    pub const fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Entry>() + self.sent.capacity() * size_of::<Aabb>()
    }
}

/// Where the boxes of a delta stand in it.
#[derive(Debug)]
pub(super) struct Places {
    of: Vec<Place>,
    /// Not 0.
    epoch: u32,
}

/// A place of the delta of an epoch.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    epoch: u32,
    at: u32,
}

impl Default for Places {
    fn default() -> Self {
        Self { of: Vec::new(), epoch: 1 }
    }
}

impl Places {
    fn clear(&mut self) {
        self.epoch = self.epoch.checked_add(1).unwrap_or_else(|| {
            self.of.fill(Place::default());
            1
        });
    }

    fn note_all(&mut self, delta: &Delta) {
        self.clear();
        for (at, (index, _)) in delta.boxes.iter().enumerate() {
            self.note(*index, at);
        }
    }

    fn note(&mut self, index: u32, at: usize) {
        if self.of.len() <= index as usize {
            self.of.resize(index as usize + 1, Place::default());
        }
        self.of[index as usize] = Place { epoch: self.epoch, at: at as u32 };
    }

    fn of(&self, index: u32) -> Option<usize> {
        let place = self.of.get(index as usize)?;
        (place.epoch == self.epoch).then_some(place.at as usize)
    }

    #[inline]
    fn ask_for(&self, index: u32) {
        ask_for(&self.of, index);
    }

    pub const fn allocated_bytes(&self) -> usize {
        self.of.capacity() * size_of::<Place>()
    }
}

/// Boxes that are prefetched this many before they are noted: so many misses of the caches overlap.
const AHEAD: usize = 16;

/// A delta that grows by what edits are about to change.
#[derive(Debug, Default)]
pub(super) struct Log {
    delta: Delta,
    places: Places,
    /// Memory of a delta that is no longer needed.
    spare: Vec<Entry>,
}

impl Log {
    pub const fn delta(&self) -> &Delta {
        &self.delta
    }

    pub fn clear(&mut self) {
        self.delta.boxes.clear();
        self.delta.sent.clear();
        self.delta.listed.clear();
        self.delta.table = None;
        self.places.clear();
    }

    /// Gives the delta away.
    pub fn take(&mut self) -> Delta {
        self.places.clear();
        let boxes = std::mem::take(&mut self.spare);
        std::mem::replace(&mut self.delta, Delta { boxes, ..Delta::default() })
    }

    /// Keeps the memory of a delta for the next one.
    pub fn recycle(&mut self, delta: Delta) {
        if delta.boxes.capacity() > self.spare.capacity() {
            self.spare = delta.boxes;
            self.spare.clear();
        }
    }

    /// Goes on with a delta.
    pub fn put(&mut self, delta: Delta) {
        self.places.note_all(&delta);
        self.delta = delta;
    }

    /// Says what the box of an index was, which is not noted yet.
    fn push(&mut self, entry: Entry, sent: Option<Aabb>) {
        self.places.note(entry.0, self.delta.boxes.len());
        self.delta.boxes.push(entry);
        self.delta.sent.extend(sent);
    }

    /// Says what a delta says, which gets what this one said of the same, or else what `replicas` say.
    pub fn swap(
        &mut self,
        delta: &mut Delta,
        replicas: &Replicas<'_>,
        incarnations: &Incarnations,
    ) {
        let Delta { boxes, sent, listed, table } = delta;
        self.delta.boxes.reserve(boxes.len());
        for at in 0..boxes.len() {
            if let Some((ahead, _)) = boxes.get(at + AHEAD) {
                self.places.ask_for(*ahead);
                replicas.now.ask_for(*ahead);
            }
            let (index, record) = &mut boxes[at];
            if let Some(own) = self.places.of(*index) {
                std::mem::swap(record, &mut self.delta.boxes[own].1);
                if let (Some(sent), Some(own)) = (sent.get_mut(at), self.delta.sent.get_mut(own)) {
                    std::mem::swap(sent, own);
                }
            } else {
                let is = record_of(*index, replicas, incarnations);
                let was_sent = sent.get_mut(at).zip(sent_of(*index, replicas));
                let was_sent = was_sent.map(|(sent, is)| std::mem::replace(sent, is));
                self.push((*index, std::mem::replace(record, is)), was_sent);
            }
        }
        let rules = replicas.rules();
        for (pair, listed) in listed {
            let own = self.delta.listed.entry(*pair);
            let own = own.or_insert_with(|| rules.lists.listed(pair[0], pair[1]));
            std::mem::swap(listed, own);
        }
        if let Some(table) = table {
            std::mem::swap(table, self.delta.table.get_or_insert_with(|| rules.table.clone()));
        }
    }

    fn note_box(&mut self, index: u32, replicas: &Replicas<'_>, incarnations: &Incarnations) {
        if self.places.of(index).is_none() {
            let record = record_of(index, replicas, incarnations);
            self.push((index, record), sent_of(index, replicas));
        }
    }

    /// Notes what the boxes of a delta are that are not noted yet.
    pub fn note_boxes(
        &mut self,
        delta: &Delta,
        replicas: &Replicas<'_>,
        incarnations: &Incarnations,
    ) {
        for (index, _) in &delta.boxes {
            self.note_box(*index, replicas, incarnations);
        }
    }

    /// Notes what an edit is about to change that is not noted yet.
    pub fn note(&mut self, edit: Edit<'_>, replicas: &Replicas<'_>, incarnations: &Incarnations) {
        let end = replicas.now.index_end();
        for step in edit.steps {
            let Some(indices) = step.indices() else { continue };
            if self.delta.boxes.is_empty() {
                self.delta.boxes.reserve(indices.len());
            }
            // What names an index without a box and sets none is wrong, or follows a set.
            let sets = matches!(step, Step::Set(_));
            let list = if let Indices::List(list) = indices { list } else { &[] };
            indices.for_each(|at, index| {
                if let Some(ahead) = list.get(at + AHEAD) {
                    self.places.ask_for(*ahead);
                    replicas.now.ask_for(*ahead);
                }
                if sets || index < end {
                    self.note_box(index, replicas, incarnations);
                }
            });
        }
        let rules = replicas.rules();
        let mut note = |pair: Pair, listed: Listed| {
            self.delta.listed.entry(pair).or_insert(listed);
        };
        let mut removed = Vec::new();
        edit.for_each_removed(|index| removed.push(index));
        rules.lists.naming(&removed).for_each(|(pair, listed)| note(pair, listed));
        for step in edit.steps {
            match step {
                Step::Include(pairs, _) | Step::Exclude(pairs, _) => {
                    for &[a, b] in *pairs {
                        note(super::super::pair_list::pair(a, b), rules.lists.listed(a, b));
                    }
                }
                Step::Filters(_) => {
                    self.delta.table.get_or_insert_with(|| rules.table.clone());
                }
                _ => {}
            }
        }
    }

    pub const fn allocated_bytes(&self) -> usize {
        self.delta.allocated_bytes()
            + self.places.allocated_bytes()
            + self.spare.capacity() * size_of::<Entry>()
    }
}

/// The box of an index as it is.
pub(super) fn record_of(
    index: u32,
    replicas: &Replicas<'_>,
    incarnations: &Incarnations,
) -> Option<BoxRecord> {
    let set = replicas.now.snapshot(index)?;
    Some(BoxRecord { set, incarnation: incarnations.of(index) })
}

/// The box of an index as it was sent, of a scene with margins; anything where there is none.
fn sent_of(index: u32, replicas: &Replicas<'_>) -> Option<Aabb> {
    replicas.sent.map(|sent| sent.get(index).unwrap_or(Aabb::EMPTY))
}
