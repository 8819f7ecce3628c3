//! What a member asks for, and why it does not get it.

use std::time::Duration;

use pairmask_core::scene::EditError;
use pairmask_core::scene::shared::{AtEnd, LeaseError, NotLeased, Scope};
use pairmask_wire::{SceneNameError, TermsDiffer};

use crate::session::error::{FrameError, WaitError};

/// What a member asks of a shared scene. What is left open, the first member or the daemon decides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct JoinOptions {
    /// Indices are below this; unless anybody says so, 2^24.
    pub most_boxes: Option<u32>,
    /// How long a tick is open after its first commit, at the most; unless anybody says so, 100 ms.
    /// At most 10 s.
    pub tick_deadline: Option<Duration>,
    /// What becomes of a dead writer's boxes; unless anybody says so, they are removed.
    pub at_end: Option<AtEnd>,
    /// Which pairs are reported to this member.
    pub scope: Scope,
}

impl JoinOptions {
    /// The same with [`most_boxes`](Self::most_boxes).
    #[must_use]
    pub const fn with_most_boxes(self, most_boxes: u32) -> Self {
        Self { most_boxes: Some(most_boxes), ..self }
    }

    /// The same with a [`tick_deadline`](Self::tick_deadline).
    #[must_use]
    pub const fn with_tick_deadline(self, deadline: Duration) -> Self {
        Self { tick_deadline: Some(deadline), ..self }
    }

    /// The same with what becomes of a dead writer's boxes.
    #[must_use]
    pub const fn with_at_end(self, at_end: AtEnd) -> Self {
        Self { at_end: Some(at_end), ..self }
    }

    /// The same for a member to which such pairs are reported.
    #[must_use]
    pub const fn with_scope(self, scope: Scope) -> Self {
        Self { scope, ..self }
    }
}

/// Why a shared scene was not joined, a lease not given, or a commit not answered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SharedError {
    /// No name of a scene.
    #[error(transparent)]
    Name(#[from] SceneNameError),
    /// The session answers in process, where there is no shared scene.
    #[error("a shared scene needs a daemon: use Backend::Auto or Backend::Daemon")]
    InProcess,
    /// Shared scenes do not tell pairs of moved boxes alone.
    #[error("a shared scene does not answer Report::Moved: ask for changes")]
    Moved,
    /// The scene has other terms than this member asks for.
    #[error(transparent)]
    Differs(#[from] TermsDiffer),
    /// The lease is refused.
    #[error(transparent)]
    Lease(#[from] LeaseError),
    /// The edit names what is not leased, and nothing of it was applied. A table of filters is refused by the
    /// daemon where another writer's lease begins lower.
    #[error(transparent)]
    NotLeased(#[from] NotLeased),
    /// The scene is no shared one.
    #[error("this scene is not shared: join one to lease indices")]
    NotShared,
    /// The edit that gives back a lease is wrong.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The request could not be sent, for want of a daemon for one. The edit of a commit is applied all the same: the
    /// next commit joins again, and has it.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// There is no answer. The next commit joins again where that is needed, and has this edit.
    #[error(transparent)]
    Wait(#[from] WaitError),
}
