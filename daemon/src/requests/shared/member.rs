//! What is kept of one member of a shared scene.

use std::sync::{Arc, Mutex};

use pairmask_core::scene::shared::{Hears, MemberId, Ranges, TickChanges, Unreported};
use pairmask_wire::{EditScratch, SceneRequest};

use super::locked;
use crate::publish::OpenRequest;

/// A member.
pub(super) struct Member {
    pub hearer: Hearer,
    /// The number of its last commit.
    pub revision: u64,
    /// Whether a lane reads an edit of it.
    pub is_reading: bool,
    /// What waits for the end of the tick.
    pub commit: Option<Commit>,
    /// Memory for reading its next edit.
    pub scratch: EditScratch,
}

/// Of what a member is to be told. Whoever ends a tick has it without its seat.
#[derive(Clone)]
pub(super) struct Hearer {
    pub id: MemberId,
    pub hears: Hears,
    /// Its leases.
    pub own: Arc<Ranges>,
    /// Locked for a moment, and nothing is locked meanwhile.
    pub unreported: Arc<Mutex<Unreported>>,
}

/// A commit that waits for the end of its tick. What it says is copied, once: the client may change or end
/// its own memory meanwhile.
pub(super) struct Commit {
    pub open: OpenRequest,
    pub request: SceneRequest,
    pub edit: EditScratch,
}

impl Member {
    pub fn new(id: MemberId, hears: Hears) -> Self {
        let hearer = Hearer { id, hears, own: Arc::default(), unreported: Arc::default() };
        let scratch = EditScratch::default();
        Self { hearer, revision: 0, is_reading: false, commit: None, scratch }
    }

    /// Whether it has a commit in the open tick, or one that is being read.
    pub const fn commits(&self) -> bool {
        self.is_reading || self.commit.is_some()
    }
}

impl Hearer {
    /// Whether it hears of a pair.
    pub fn hears_of(&self, [a, b]: [u32; 2]) -> bool {
        self.hears == Hears::All || self.own.has(a) || self.own.has(b)
    }

    /// Notes what it is to be told.
    pub fn note(&self, changes: &TickChanges) {
        let mut unreported = locked(&self.unreported);
        match self.hears {
            Hears::All => unreported.note(changes, |_| true),
            Hears::Own => unreported.note(changes, |pair| self.hears_of(pair)),
        }
    }

    /// It does not know what it was told.
    pub fn lose(&self) {
        locked(&self.unreported).lose();
    }

    /// Bytes that are kept of it.
    pub fn bytes(&self) -> u64 {
        locked(&self.unreported).allocated_bytes() as u64
    }
}
