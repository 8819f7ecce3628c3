//! Scenes that the daemon keeps for its clients, from edit to edit.
//!
//! A scene belongs to a session. A client sends again what was dropped.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pairmask_core::scene::Edit;
use pairmask_wire::{EditScratch, SceneId};

use crate::audit::AuditedScene;
use crate::execute::SceneHost;

/// Bytes that a scene takes for each index, whether it has a box or not.
const BYTES_AN_INDEX: u64 = 25;
/// Bytes that it takes for each box on top, at the most: cells, history and answers.
const BYTES_A_BOX: u64 = 275;
/// Bytes that it takes for each box on each GPU beside the first one that has it, at the most: records, and the grid
/// of a search among all.
const BYTES_ON_A_FURTHER_GPU: u64 = 200;
/// Bytes that rules take for each index on top, where there are any: its filter data.
const BYTES_A_FILTER_DATA: u64 = 12;
/// Bytes that any scene takes: without them, empty ones would be free.
const BYTES_A_SCENE: u64 = 64 << 10;

pub(crate) struct SessionScene {
    pub(crate) id: SceneId,
    pub(crate) revision: u64,
    pub(crate) scene: SceneHost,
    pub(crate) scratch: EditScratch,
    /// Memory for what queries find, kept so that it is not mapped for each anew.
    pub(crate) found: Vec<[u32; 2]>,
    pub(crate) room: SceneRoom,
    pub(crate) audited: Option<AuditedScene>,
}

/// The share of a scene in the memory of all. It goes back with the scene.
#[derive(Debug)]
pub(crate) struct SceneRoom {
    of: Arc<Shared>,
    bytes: u64,
}

/// Boxes that edits set which wait to be applied.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PendingBoxes {
    pub(crate) count: u64,
    /// Their indices are below this.
    pub(crate) index_end: u64,
}

impl SceneRoom {
    pub(crate) fn begin(memory: &SceneMemory) -> Result<Self, NoRoom> {
        memory.charge(BYTES_A_SCENE)
    }

    /// Makes room for an edit that is applied with others, so many bytes being kept `beside` it.
    pub(crate) fn make(
        &mut self,
        scene: &mut SceneHost,
        edit: Edit<'_>,
        others: PendingBoxes,
        beside: u64,
    ) -> Result<(), NoRoom> {
        let set = edit.boxes() as u64 + others.count;
        let indices = edit.index_end().max(others.index_end).max(scene.index_end().into());
        // Those that move are there already: there are no more boxes than indices.
        let boxes = (scene.len() as u64 + set).min(indices);
        let filters = scene.filters();
        let rules = if filters.is_used() || edit.has_rules() {
            filters.allocated_bytes() as u64
                + BYTES_A_FILTER_DATA * indices
                + edit.rule_bytes() as u64
        } else {
            0
        };
        let bytes = |gpus: usize| {
            let bytes_a_box = BYTES_A_BOX + BYTES_ON_A_FURTHER_GPU * (gpus as u64 - 1);
            let of_boxes = BYTES_AN_INDEX * indices + bytes_a_box * boxes;
            BYTES_A_SCENE + of_boxes + rules + edit.user_data_bytes() + beside
        };
        // What does not fit several GPUs is kept on fewer.
        let fit = self.most_that_fit(scene.most_copies(set as usize), bytes);
        scene.limit_gpus(fit);
        // The cores have one copy until the scene moves, and what it takes then is noted.
        self.grow_to(bytes(if scene.gpu_count() == 0 { 1 } else { fit }))
    }

    /// Notes what the scene takes by now, where so many bytes are kept beside it.
    pub(crate) fn note(&mut self, scene: &SceneHost, beside: u64) {
        let scene_bytes = scene.bytes();
        self.set(BYTES_A_SCENE + scene_bytes + beside);
    }

    /// Takes more, so that it is at least so much; without room it stays what it was.
    fn grow_to(&mut self, bytes: u64) -> Result<(), NoRoom> {
        if let Some(more) = bytes.checked_sub(self.bytes) {
            self.of.take(more)?;
            self.bytes = bytes;
        }
        Ok(())
    }

    /// The largest number of copies, from `most` down to one, whose bytes there is room for; one where there is none.
    fn most_that_fit(&self, most: usize, bytes: impl Fn(usize) -> u64) -> usize {
        let others = self.of.used.load(Ordering::Relaxed).saturating_sub(self.bytes);
        let fits = |copies: &usize| others.saturating_add(bytes(*copies)) <= self.of.limit;
        (1..=most).rev().find(fits).unwrap_or(1)
    }

    fn set(&mut self, bytes: u64) {
        self.of.used.fetch_add(bytes, Ordering::Relaxed);
        self.of.used.fetch_sub(self.bytes, Ordering::Relaxed);
        self.bytes = bytes;
    }
}

const BYTES_A_PAIR: u64 = 8;

#[derive(Clone, Debug)]
pub(crate) struct SceneMemory(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    limit: u64,
    used: AtomicU64,
    scenes: AtomicU64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "scenes would take {needed_bytes} bytes, and may take {limit_bytes}: serve with a larger --max-scene-mib"
)]
pub(crate) struct NoRoom {
    pub(crate) needed_bytes: u64,
    pub(crate) limit_bytes: u64,
}

impl SceneMemory {
    pub(crate) fn new(limit: u64) -> Self {
        Self(Arc::new(Shared { limit, used: AtomicU64::new(0), scenes: AtomicU64::new(0) }))
    }

    fn charge(&self, bytes: u64) -> Result<SceneRoom, NoRoom> {
        self.0.take(bytes)?;
        self.0.scenes.fetch_add(1, Ordering::Relaxed);
        Ok(SceneRoom { of: Arc::clone(&self.0), bytes })
    }

    /// Most pairs that a search among all boxes of a scene may find, where an answer has room for so many: as many as
    /// all scenes may take memory for, since rules leave few of them in the answer.
    pub(crate) fn most_pairs(&self, of_answer: u64) -> u64 {
        of_answer.max(self.0.limit / BYTES_A_PAIR)
    }

    pub(crate) fn used(&self) -> (u64, u64) {
        (self.0.scenes.load(Ordering::Relaxed), self.0.used.load(Ordering::Relaxed))
    }
}

impl Shared {
    fn take(&self, bytes: u64) -> Result<(), NoRoom> {
        let needed = |used: u64| used.saturating_add(bytes);
        let more = |used| (needed(used) <= self.limit).then(|| needed(used));
        let taken = self.used.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more);
        let no_room = |used| NoRoom { needed_bytes: needed(used), limit_bytes: self.limit };
        taken.map(drop).map_err(no_room)
    }
}

impl Drop for SceneRoom {
    fn drop(&mut self) {
        self.of.used.fetch_sub(self.bytes, Ordering::Relaxed);
        self.of.scenes.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_several_gpus_is_kept_on_fewer() {
        let memory = SceneMemory::new(100);
        let (mut one, two) = (memory.charge(10).expect("room"), memory.charge(20).expect("room"));
        let bytes = |copies: usize| 30 * copies as u64;
        assert_eq!([1, 2, 3, 4].map(|most| one.most_that_fit(most, bytes)), [1, 2, 2, 2]);
        drop(two);
        assert_eq!(one.most_that_fit(4, bytes), 3);
        assert!(one.grow_to(bytes(3)).is_ok() && one.grow_to(bytes(4)).is_err());
        assert_eq!(one.most_that_fit(4, |_| 101), 1, "which is refused");
    }

    #[test]
    fn scenes_take_no_more_than_they_may_and_give_it_back() {
        let memory = SceneMemory::new(100);
        let mut one = memory.charge(40).expect("room");
        let two = memory.charge(50).expect("room");
        assert_eq!(memory.used(), (2, 90));
        let refused = one.grow_to(51).expect_err("101 of 100");
        assert_eq!(refused, NoRoom { needed_bytes: 101, limit_bytes: 100 });
        assert!(one.grow_to(30).is_ok() && one.grow_to(50).is_ok());
        assert!(memory.charge(1).is_err());
        drop(two);
        one.set(120);
        assert_eq!(memory.used(), (1, 120), "what is known afterwards may be more");
        assert!(memory.charge(0).is_err());
        drop(one);
        assert_eq!(memory.used(), (0, 0));
        assert!(memory.charge(u64::MAX).is_err());
    }
}
