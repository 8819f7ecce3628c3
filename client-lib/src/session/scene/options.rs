//! What a session asks of a scene.

use std::time::Duration;

use pairmask_core::precision::Margin;
use pairmask_core::scene::SceneOptions as CoreOptions;
use pairmask_core::scene::shared::{AtEnd, Scope};

/// What a [scene](super::Scene) may hold, whether its boxes have margins, and whether other processes write it too.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SceneOptions {
    /// Indices are below this. At most 2^29; unless set, 2^24, or what the first member of a shared scene said.
    pub most_boxes: Option<u32>,
    /// Most threads of an edit or query; `None`: the session's. With one, no pool of threads is touched.
    pub threads: Option<usize>,
    /// The margin of boxes that are set without one of their own; `None`: boxes have no margins. A box is inflated by
    /// its margin when it is sent, and is sent again only when it no longer lies within what was sent, or has become so
    /// small that a face of that lies farther outward than four margins. A box with a margin of 0 is sent as it is,
    /// whenever it changes. An edit that sends no box, removes nothing and changes no flag and no filter data makes no
    /// request to the daemon, except in a shared scene, whose ticks wait for it.
    ///
    /// Memory of this process, beside that of the scene without: 25 bytes for each index. With exact pairs 50
    /// bytes for each index, and 8 to 16 for each near pair.
    pub margin: Option<Margin>,
    /// Whether a scene with margins reports near pairs, those of the inflated boxes: all that overlap, and some with a
    /// gap of at most four times the sum of their margins and four steps of f32 on each axis. This process keeps no
    /// pairs then.
    ///
    /// Else it reports exact pairs: answers are those of a scene of the boxes as they were set, byte-identical except
    /// for resyncs. This process keeps the near pairs, and an edit tests those around the boxes that it changes. Where a
    /// daemon loses the scene, the next changes are changes all the same; a resync comes only where there are more
    /// changes than pairs, and after the client has asked for one.
    ///
    /// A shared scene reports near pairs in either case: to other members, a box within its margin has not moved.
    pub near_pairs: bool,
    /// The name of a scene that several processes write, each its own boxes: 1 to 64 letters, digits and `-_.:/`.
    /// `None`: the scene is this session's alone.
    pub shared: Option<String>,
    /// How long a tick of a shared scene is open after its first commit, at the most; unless a member says so, 100 ms.
    /// At most 10 s.
    pub tick_deadline: Option<Duration>,
    /// What becomes of the boxes of a shared scene's writer that dies; unless a member says so, they are removed.
    pub at_end: Option<AtEnd>,
    /// Which pairs of a shared scene are reported to this member.
    pub scope: Scope,
}

impl SceneOptions {
    /// The same with [`most_boxes`](Self::most_boxes).
    #[must_use]
    pub fn with_most_boxes(self, most_boxes: u32) -> Self {
        Self { most_boxes: Some(most_boxes), ..self }
    }

    /// The same with [`threads`](Self::threads).
    #[must_use]
    pub fn with_threads(self, threads: usize) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// The same with boxes that have [margins](Self::margin).
    #[must_use]
    pub fn with_margin(self, usual: Margin) -> Self {
        Self { margin: Some(usual), ..self }
    }

    /// The same with [`near_pairs`](Self::near_pairs) or without.
    #[must_use]
    pub fn with_near_pairs(self, near_pairs: bool) -> Self {
        Self { near_pairs, ..self }
    }

    /// The same as a member of the [shared](Self::shared) scene of this name.
    #[must_use]
    pub fn with_shared(self, name: impl Into<String>) -> Self {
        Self { shared: Some(name.into()), ..self }
    }

    /// The same with a [`tick_deadline`](Self::tick_deadline).
    #[must_use]
    pub fn with_tick_deadline(self, deadline: Duration) -> Self {
        Self { tick_deadline: Some(deadline), ..self }
    }

    /// The same with what becomes of a dead writer's boxes.
    #[must_use]
    pub fn with_at_end(self, at_end: AtEnd) -> Self {
        Self { at_end: Some(at_end), ..self }
    }

    /// The same for a member to which such pairs are reported.
    #[must_use]
    pub fn with_scope(self, scope: Scope) -> Self {
        Self { scope, ..self }
    }
}

impl SceneOptions {
    /// Of a scene without a session, with the session's threads where these options name none.
    pub(super) fn without_session(&self, threads: Option<usize>) -> CoreOptions {
        let mut options = CoreOptions::default();
        options.threads = self.threads.or(threads);
        options.most_boxes = self.most_boxes.unwrap_or(options.most_boxes);
        options.within_limits()
    }
}
