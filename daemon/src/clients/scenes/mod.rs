//! Scenes that the daemon keeps for its clients, from edit to edit.
//!
//! A scene belongs to a session. A client sends again what was forgotten.

mod memory;

use pairmask_core::scene::Edit;
use pairmask_wire::{EditScratch, SceneId};

use self::memory::Charge;
pub(crate) use self::memory::{NoRoom, SceneMemory};
use crate::audit::AuditedScene;
use crate::execute::SceneKeeper;

/// Bytes that a scene takes for each index, whether it has a box or not.
const BYTES_AN_INDEX: u64 = 25;
/// Bytes that it takes for each box on top, at the most: cells, history and answers.
const BYTES_A_BOX: u64 = 275;
/// Bytes that it takes for each box on each GPU beside the first one that has it, at the most: records, and the grid
/// of a search among all.
const BYTES_ON_A_FURTHER_GPU: u64 = 200;
/// Bytes that rules take for each index on top, where there are any: its tag.
const BYTES_A_TAG: u64 = 12;
/// Bytes that any scene takes: without them, empty ones would be free.
const BYTES_A_SCENE: u64 = 64 << 10;

/// Most pairs whose memory a scene keeps between queries: 8 MiB, 2,048 pages. To find more takes far longer than
/// to map their memory.
const MOST_KEPT_PAIRS: usize = 1 << 20;

/// A scene of a client.
#[derive(Debug)]
pub(crate) struct KeptScene {
    id: SceneId,
    /// The number of the last edit.
    pub(crate) revision: u64,
    /// Its boxes, and what was told.
    pub(crate) scene: SceneKeeper,
    /// Memory for reading edits.
    pub(crate) scratch: EditScratch,
    /// Memory for what queries find.
    pub(crate) found: FoundPairs,
    /// Its share of the memory of all scenes.
    pub(crate) room: SceneRoom,
    /// Where it is audited.
    pub(crate) audited: Option<AuditedScene>,
}

/// Memory for what queries find, kept so that it is not mapped for each anew.
#[derive(Debug, Default)]
pub(crate) struct FoundPairs(Vec<[u32; 2]>);

impl FoundPairs {
    /// The memory, and all that is in it.
    pub(crate) const fn pairs(&mut self) -> &mut Vec<[u32; 2]> {
        &mut self.0
    }

    /// Gives back what is too large to keep.
    pub(crate) fn tidy(&mut self) {
        if self.0.capacity() > MOST_KEPT_PAIRS {
            self.0 = Vec::new();
        }
    }

    /// Bytes that it takes.
    pub(crate) const fn bytes(&self) -> u64 {
        (self.0.capacity() * size_of::<[u32; 2]>()) as u64
    }
}

/// The share of a scene in the memory of all.
#[derive(Debug)]
pub(crate) struct SceneRoom(Charge);

/// Boxes that edits set which wait to be applied.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PendingBoxes {
    /// How many.
    pub(crate) count: u64,
    /// Their indices are below this.
    pub(crate) index_end: u64,
}

impl KeptScene {
    /// A scene without boxes, before its first edit.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub(crate) fn begin(
        id: SceneId,
        scene: SceneKeeper,
        audited: Option<AuditedScene>,
        memory: &SceneMemory,
    ) -> Result<Self, NoRoom> {
        Ok(Self {
            id,
            revision: 0,
            scene,
            scratch: EditScratch::default(),
            found: FoundPairs::default(),
            room: SceneRoom::begin(memory)?,
            audited,
        })
    }

    /// The client's number of it.
    pub(crate) const fn id(&self) -> SceneId {
        self.id
    }
}

impl SceneRoom {
    /// The share of a scene without boxes.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub(crate) fn begin(memory: &SceneMemory) -> Result<Self, NoRoom> {
        memory.charge(BYTES_A_SCENE).map(Self)
    }

    /// Makes room for an edit that is about to be applied together with others, where so many bytes are kept beside the
    /// scene.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub(crate) fn make(
        &mut self,
        scene: &mut SceneKeeper,
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
            filters.allocated_bytes() as u64 + BYTES_A_TAG * indices + edit.rule_bytes() as u64
        } else {
            0
        };
        let bytes = |gpus: usize| {
            let bytes_a_box = BYTES_A_BOX + BYTES_ON_A_FURTHER_GPU * (gpus as u64 - 1);
            BYTES_A_SCENE + BYTES_AN_INDEX * indices + bytes_a_box * boxes + rules + beside
        };
        // What does not fit several GPUs is kept on fewer.
        let fit = self.0.most_that_fit(scene.most_copies(set as usize), bytes);
        scene.limit_gpus(fit);
        // The cores have one copy until the scene moves, and what it takes then is noted.
        self.0.grow_to(bytes(if scene.gpu_count() == 0 { 1 } else { fit }))
    }

    /// Notes what the scene takes by now, where so many bytes are kept beside it.
    pub(crate) fn note(&mut self, scene: &SceneKeeper, beside: u64) {
        let scene_bytes = scene.bytes();
        self.0.set(BYTES_A_SCENE + scene_bytes + beside);
    }
}
