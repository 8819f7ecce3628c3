//! What is kept of one member of a shared scene.

use pairmask_core::scene::shared::{Hears, Ranges, Untold};
use pairmask_core::scene::{Edit, Step};
use pairmask_wire::{EditScratch, Page, Reject, SceneRequest};

use crate::publish::OpenRequest;

/// A member.
pub(super) struct Member {
    pub hears: Hears,
    /// Its leases.
    pub own: Ranges,
    pub untold: Untold,
    /// The number of its last commit.
    pub revision: u64,
    /// What waits for the end of the tick.
    pub commit: Option<Commit>,
}

/// A commit that waits for the end of its tick. What it says is copied, once: the client may change or end
/// its own memory meanwhile.
pub(super) struct Commit {
    pub open: OpenRequest,
    pub request: SceneRequest,
    pages: Vec<Page>,
    scratch: EditScratch,
}

impl Member {
    pub fn new(hears: Hears) -> Self {
        let (own, untold) = (Ranges::default(), Untold::default());
        Self { hears, own, untold, revision: 0, commit: None }
    }

    /// Whether it hears of a pair.
    pub fn hears_of(&self, [a, b]: [u32; 2]) -> bool {
        self.hears == Hears::All || self.own.has(a) || self.own.has(b)
    }

    /// Bytes that are kept of it.
    pub fn bytes(&self) -> u64 {
        let pages = self.commit.as_ref().map_or(0, |commit| size_of_val(commit.pages.as_slice()));
        (self.untold.allocated_bytes() + pages) as u64
    }
}

impl Commit {
    pub fn new(open: OpenRequest, request: SceneRequest) -> Self {
        let pages = open.pages().to_vec();
        Self { open, request, pages, scratch: EditScratch::default() }
    }

    /// The steps of its edit.
    ///
    /// # Errors
    /// [`Reject`] where they are malformed.
    pub fn steps(&mut self) -> Result<Vec<Step<'_>>, Reject> {
        self.scratch.read(&self.request, &self.pages)
    }

    /// Bytes of the copy.
    pub fn bytes(&self) -> u64 {
        size_of_val(self.pages.as_slice()) as u64
    }
}

/// Indices that an edit removes.
pub(super) fn removed_by(edit: Edit<'_>) -> impl Iterator<Item = u32> {
    let mut removed = Vec::new();
    for step in edit.steps {
        if let Step::Remove(indices) = step {
            indices.for_each(|_, index| removed.push(index));
        }
    }
    removed.into_iter()
}
