//! Scenes that the daemon keeps for its clients, from edit to edit.
//!
//! A scene belongs to a session. A client sends again what was dropped.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pairmask_core::scene::Edit;
use pairmask_transport::{Charge, Memory, OverBudget, SceneSlot, Share};
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

/// The memory of a scene. It goes back with the scene.
#[derive(Debug)]
pub(crate) struct SceneRoom {
    charge: Charge,
    totals: SceneTotals,
    counts: SceneSlot,
}

/// Boxes that edits set which wait to be applied.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PendingBoxes {
    pub(crate) count: u64,
    /// Their indices are below this.
    pub(crate) index_end: u64,
}

impl SceneRoom {
    pub(crate) fn begin(
        totals: &SceneTotals,
        share: &Share,
        counts: SceneSlot,
    ) -> Result<Self, OverBudget> {
        let charge = share.charge(Memory::Own, BYTES_A_SCENE)?;
        totals.0.scenes.fetch_add(1, Ordering::Relaxed);
        totals.0.bytes.fetch_add(BYTES_A_SCENE, Ordering::Relaxed);
        Ok(Self { charge, totals: totals.clone(), counts })
    }

    /// What the scene takes, counted.
    pub(crate) const fn counts(&self) -> &SceneSlot {
        &self.counts
    }

    /// Makes room for an edit that is applied with others, so many bytes being kept `beside` it.
    pub(crate) fn make(
        &mut self,
        scene: &mut SceneHost,
        edit: Edit<'_>,
        others: PendingBoxes,
        beside: u64,
    ) -> Result<(), OverBudget> {
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
        self.counts.note_size(scene.len() as u64, self.charge.bytes());
    }

    /// Takes more, so that it is at least so much; without room it stays what it was.
    fn grow_to(&mut self, bytes: u64) -> Result<(), OverBudget> {
        let before = self.charge.bytes();
        self.charge.grow_to(bytes)?;
        self.count(before);
        Ok(())
    }

    /// The largest number of copies, from `most` down to one, whose bytes there is room for; one where there is none.
    fn most_that_fit(&self, most: usize, bytes: impl Fn(usize) -> u64) -> usize {
        let room = self.charge.bytes().saturating_add(self.charge.share().left());
        (1..=most).rev().find(|copies| bytes(*copies) <= room).unwrap_or(1)
    }

    /// Whether its client may take so many bytes on top.
    pub(crate) fn has(&self, bytes: u64) -> bool {
        bytes <= self.charge.share().left()
    }

    fn set(&mut self, bytes: u64) {
        let before = self.charge.bytes();
        self.charge.set(bytes);
        self.count(before);
    }

    fn count(&self, before: u64) {
        let bytes = &self.totals.0.bytes;
        bytes.fetch_add(self.charge.bytes(), Ordering::Relaxed);
        bytes.fetch_sub(before, Ordering::Relaxed);
    }

    /// Most pairs that a search among all boxes of the scene may find, where an answer has room for so many: as many as
    /// its client may take memory for, since rules leave few of them in the answer.
    pub(crate) fn most_pairs(&self, of_answer: u64) -> u64 {
        of_answer.max(self.charge.share().left() / BYTES_A_FOUND_PAIR)
    }
}

/// Bytes that a pair takes which a search among all finds: in the engine's list, sorted, in the list of before and in
/// that of now.
const BYTES_A_FOUND_PAIR: u64 = 32;

/// How many scenes there are, and what they take.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneTotals(Arc<Totals>);

#[derive(Debug, Default)]
struct Totals {
    bytes: AtomicU64,
    scenes: AtomicU64,
}

impl SceneTotals {
    /// Scenes, and their bytes.
    pub(crate) fn get(&self) -> (u64, u64) {
        (self.0.scenes.load(Ordering::Relaxed), self.0.bytes.load(Ordering::Relaxed))
    }
}

impl Drop for SceneRoom {
    fn drop(&mut self) {
        self.totals.0.bytes.fetch_sub(self.charge.bytes(), Ordering::Relaxed);
        self.totals.0.scenes.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use pairmask_transport::{Budget, Counters};

    use super::*;

    const MIB: u64 = 1 << 20;

    fn counts() -> SceneSlot {
        Counters::unseen(1).scene(1, 1)
    }

    #[test]
    fn what_does_not_fit_several_gpus_is_kept_on_fewer() {
        let share = Budget::new(200 * MIB, 1).share();
        let totals = SceneTotals::default();
        let mut one = SceneRoom::begin(&totals, &share, counts()).expect("room");
        let two = share.charge(Memory::Own, 30 * MIB).expect("room");
        let bytes = |copies: usize| 30 * MIB * copies as u64;
        assert_eq!([1, 2, 3, 4].map(|most| one.most_that_fit(most, bytes)), [1, 2, 2, 2]);
        drop(two);
        assert_eq!(one.most_that_fit(4, bytes), 3);
        assert!(one.grow_to(bytes(3)).is_ok() && one.grow_to(bytes(4)).is_err());
        assert_eq!(one.most_that_fit(4, |_| 101 * MIB), 1, "which is refused");
    }

    #[test]
    fn scenes_are_counted_as_they_come_grow_and_go() {
        let share = Budget::new(200 * MIB, 1).share();
        let totals = SceneTotals::default();
        let mut one = SceneRoom::begin(&totals, &share, counts()).expect("room");
        let two = SceneRoom::begin(&totals, &share, counts()).expect("room");
        assert!(one.grow_to(101 * MIB).is_err() && one.grow_to(50 * MIB).is_ok());
        assert_eq!(totals.get(), (2, 50 * MIB + BYTES_A_SCENE));
        drop(two);
        one.set(120 * MIB);
        assert_eq!(totals.get(), (1, 120 * MIB), "what is known afterwards may be more");
        assert!(SceneRoom::begin(&totals, &share, counts()).is_err());
        drop(one);
        assert_eq!((totals.get(), share.left()), ((0, 0), 100 * MIB));
    }
}
