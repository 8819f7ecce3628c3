//! What a member asks for.

use std::time::Duration;

use pairmask_core::scene::shared::{AtEnd, Scope};

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
