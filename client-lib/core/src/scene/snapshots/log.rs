//! What boxes and rules were before they changed.

use std::collections::{HashMap, HashSet};

use super::super::edit::{Edit, Step};
use super::super::pair_list::Pair;
use super::super::snapshot::BoxSnapshot;
use super::Replicas;
use super::restore::Incarnations;
use crate::aabb::Aabb;
use crate::filters::{FilterTable, Listed};

/// A box of the scene, and which one of those that its index has had.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoxRecord {
    pub set: BoxSnapshot,
    /// The box as it was sent: inflated, where it has a margin.
    pub sent: Aabb,
    pub incarnation: u32,
}

/// What of a scene is, or was, another than in a second one: as it is in the first.
#[derive(Clone, Debug, Default)]
pub(super) struct Delta {
    /// By index, each once; `None` where there was no box.
    pub boxes: Vec<(u32, Option<BoxRecord>)>,
    pub listed: HashMap<Pair, Listed>,
    pub table: Option<FilterTable>,
}

impl Delta {
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.listed.is_empty() && self.table.is_none()
    }

    /// From a first scene by a second to a third: this one leads from the first to the second.
    pub fn then(mut self, later: Self) -> Self {
        let own: HashSet<u32> = self.boxes.iter().map(|(index, _)| *index).collect();
        self.boxes.extend(later.boxes.into_iter().filter(|(index, _)| !own.contains(index)));
        for (pair, listed) in later.listed {
            self.listed.entry(pair).or_insert(listed);
        }
        self.table = self.table.or(later.table);
        self
    }

    pub const fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<(u32, Option<BoxRecord>)>()
    }
}

/// Where a box stands in the delta, if its epoch is that of the log.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    epoch: u32,
    at: u32,
}

/// A delta that grows by what edits are about to change.
#[derive(Debug)]
pub(super) struct Log {
    delta: Delta,
    places: Vec<Place>,
    /// Not 0.
    epoch: u32,
}

impl Default for Log {
    fn default() -> Self {
        Self { delta: Delta::default(), places: Vec::new(), epoch: 1 }
    }
}

impl Log {
    pub const fn delta(&self) -> &Delta {
        &self.delta
    }

    fn forget_places(&mut self) {
        self.epoch = self.epoch.checked_add(1).unwrap_or_else(|| {
            self.places.fill(Place::default());
            1
        });
    }

    pub fn clear(&mut self) {
        self.delta.boxes.clear();
        self.delta.listed.clear();
        self.delta.table = None;
        self.forget_places();
    }

    /// Gives the delta away.
    pub fn take(&mut self) -> Delta {
        self.forget_places();
        std::mem::take(&mut self.delta)
    }

    /// Goes on with a delta.
    pub fn put(&mut self, delta: Delta) {
        self.forget_places();
        self.delta = delta;
        for at in 0..self.delta.boxes.len() {
            let index = self.delta.boxes[at].0;
            self.note_place(index, at);
        }
    }

    fn note_place(&mut self, index: u32, at: usize) {
        if self.places.len() <= index as usize {
            self.places.resize(index as usize + 1, Place::default());
        }
        self.places[index as usize] = Place { epoch: self.epoch, at: at as u32 };
    }

    fn place(&self, index: u32) -> Option<usize> {
        let place = self.places.get(index as usize)?;
        (place.epoch == self.epoch).then_some(place.at as usize)
    }

    /// What the box of an index was, if that is noted.
    pub fn get(&self, index: u32) -> Option<Option<BoxRecord>> {
        self.place(index).map(|at| self.delta.boxes[at].1)
    }

    /// Says what the box of an index was.
    pub fn set(&mut self, index: u32, record: Option<BoxRecord>) {
        if let Some(at) = self.place(index) {
            self.delta.boxes[at].1 = record;
        } else {
            self.note_place(index, self.delta.boxes.len());
            self.delta.boxes.push((index, record));
        }
    }

    /// Sets what a delta says, and returns what this one said of the same, or else what `replicas` say.
    pub fn override_by(
        &mut self,
        delta: &Delta,
        replicas: &Replicas<'_>,
        incarnations: &Incarnations,
    ) -> Delta {
        let mut before = Delta::default();
        before.boxes.reserve(delta.boxes.len());
        for &(index, record) in &delta.boxes {
            let was = self.get(index).unwrap_or_else(|| record_of(index, replicas, incarnations));
            before.boxes.push((index, was));
            self.set(index, record);
        }
        let rules = replicas.rules();
        for (&pair, &listed) in &delta.listed {
            let was = self.delta.listed.insert(pair, listed);
            before.listed.insert(pair, was.unwrap_or_else(|| rules.lists.listed(pair[0], pair[1])));
        }
        if let Some(table) = &delta.table {
            let was = self.delta.table.replace(table.clone());
            before.table = Some(was.unwrap_or_else(|| rules.table.clone()));
        }
        before
    }

    /// Notes what an edit is about to change that is not noted yet.
    pub fn note(&mut self, edit: Edit<'_>, replicas: &Replicas<'_>, incarnations: &Incarnations) {
        for step in edit.steps {
            if let Some(indices) = step.indices() {
                indices.for_each(|_, index| {
                    if self.place(index).is_none() {
                        self.set(index, record_of(index, replicas, incarnations));
                    }
                });
            }
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
        self.delta.allocated_bytes() + self.places.capacity() * size_of::<Place>()
    }
}

/// The box of an index as it is.
pub(super) fn record_of(
    index: u32,
    replicas: &Replicas<'_>,
    incarnations: &Incarnations,
) -> Option<BoxRecord> {
    let set = replicas.now.snapshot(index)?;
    let sent = replicas.sent.and_then(|sent| sent.get(index)).unwrap_or(set.b);
    Some(BoxRecord { set, sent, incarnation: incarnations.of(index) })
}
