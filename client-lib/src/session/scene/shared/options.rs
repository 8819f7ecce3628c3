//! What a member asks for.

use std::time::Duration;

use pairmask_core::precision::Margin;
use pairmask_core::scene::shared::{AtEnd, Scope};

/// What a member asks of a shared scene. What is left open, the first member or the daemon decides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    /// The usual margin of the boxes that this member sets; `None`: they have none. Pairs of a shared scene are those
    /// of the boxes as members have sent them: [near](pairmask_core::scene::MarginedPairs::Near) pairs, of fat AABBs,
    /// where a box has a margin. To other members, a box that stays within its margin has not moved. An edit that
    /// sends no box is committed all the same: ticks wait for it.
    pub usual_margin: Option<Margin>,
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

    /// The same with boxes that have margins.
    #[must_use]
    pub const fn with_usual_margin(self, usual: Margin) -> Self {
        Self { usual_margin: Some(usual), ..self }
    }
}
