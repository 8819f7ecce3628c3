//! Scenes whose boxes have margins: only boxes that left theirs are sent.
//!
//! What was sent is what the scene keeps anyway, so that it is sent again, or taken over by this process,
//! with its margins. The boxes of now are in a copy beside it, to which an edit is applied exactly where the
//! scene applies its part of the edit.

mod answer;
mod edit;
mod pairs;

use pairmask_core::aabb::Aabb;
use pairmask_core::precision::Margin;
use pairmask_core::scene::{Outgoing, SceneCopy, SceneOptions};

pub use self::answer::{MarginedAnswer, PendingMargined};
pub use self::edit::MarginedEdit;
use self::pairs::Pairs;
use super::Scene;

/// Which pairs a [`MarginedScene`] tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MarginedPairs {
    /// Pairs of the inflated boxes: those that overlap, and some that are near. This process keeps no pairs.
    Near,
    /// Pairs of the boxes as they were set, no more and no less. This process keeps the near pairs and tests
    /// them.
    Exact,
}

/// Boxes that were set, and how few of them were sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MarginedSceneStats {
    /// Edits that were applied.
    pub edits: u64,
    /// Edits for which a request was made; the others needed none.
    pub requests: u64,
    /// Boxes that edits set.
    pub set: u64,
    /// Boxes that were sent.
    pub sent: u64,
}

/// Boxes that persist from answer to answer, each with a margin. Made by
/// [`Session::margined_scene`](crate::Session::margined_scene); it lives on without the session.
///
/// A box is inflated by its margin when it is sent, and is sent again only when it no longer lies within what
/// was sent, or has become so small that a face of that lies farther outward than four margins. A box with a
/// margin of 0 is sent as it is, whenever it changes. An edit that sends no box, removes, switches and flags
/// nothing makes no request to the daemon.
///
/// **[Near](MarginedPairs::Near) pairs** are those of the inflated boxes: they begin and end as in a
/// [`Scene`] of these. The overlapping pairs are among them. On each axis, boxes of a near pair have a gap of
/// at most four times the sum of their margins and four steps of f32.
///
/// **[Exact](MarginedPairs::Exact) pairs** are those of the boxes as they were set: answers are those of a
/// [`Scene`] of these boxes, bit by bit. This process keeps the near pairs, and an edit tests those around
/// the boxes that it changes. What was told is known here: where a daemon loses the scene, the next changes
/// are changes all the same. A resync comes only where there are more changes than pairs, and after
/// [`lose`](Self::lose).
///
/// Memory of this process, beside that of the [`Scene`]: 25 bytes for each index. With exact pairs 50
/// bytes for each index, and 8 to 16 for each near pair.
///
/// ```
/// use pairmask::scene::{SceneOptions, Want};
/// use pairmask::{Aabb, Backend, Margin, MarginedPairs, Session};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
/// let mut scene = session.margined_scene(SceneOptions::default(), MarginedPairs::Exact);
/// let at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
/// let margin = Margin::new(0.5)?;
///
/// let edit = scene.edit().set(7, at(0.0), Margin::default()).set(9, at(1.2), margin);
/// assert!(edit.commit(Want::Changes)?.take().begun().is_empty());
///
/// // Within its margin: no request is made, and the pair is told.
/// let answer = scene.edit().set(9, at(0.8), margin).commit(Want::Changes)?.take();
/// assert_eq!(answer.begun(), [[7, 9]]);
/// drop(answer);
/// assert_eq!((scene.stats().requests, scene.stats().sent), (1, 2));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct MarginedScene {
    /// Of the boxes that were sent.
    scene: Scene,
    /// The boxes of now.
    now: SceneCopy,
    pairs: Pairs,
    draft: Draft,
    outgoing: Outgoing,
    /// Threads of this process; `None` is all of its pool.
    threads: Option<usize>,
    stats: MarginedSceneStats,
}

/// What an edit sets one by one; kept, so that steady edits allocate nothing.
#[derive(Debug, Default)]
struct Draft {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
    margins: Vec<Margin>,
    removed: Vec<u32>,
}

impl MarginedScene {
    pub(in super::super) fn new(
        scene: Scene,
        options: SceneOptions,
        threads: Option<usize>,
        pairs: MarginedPairs,
    ) -> Self {
        Self {
            scene,
            now: SceneCopy::new(options.most_boxes),
            pairs: Pairs::new(pairs),
            draft: Draft::default(),
            outgoing: Outgoing::default(),
            threads,
            stats: MarginedSceneStats::default(),
        }
    }

    /// Begins an edit. Without [`MarginedEdit::commit`], nothing happens.
    pub fn edit<'a>(&mut self) -> MarginedEdit<'_, 'a> {
        self.draft.indices.clear();
        self.draft.boxes.clear();
        self.draft.margins.clear();
        self.draft.removed.clear();
        MarginedEdit::new(self)
    }

    /// Forgets what was told: the next changes are a [resync](MarginedAnswer::is_resync).
    pub fn lose(&mut self) {
        match &mut self.pairs {
            Pairs::Near(near) => {
                self.scene.lose();
                near.note_lost();
            }
            Pairs::Exact(exact) => exact.lose(),
        }
    }

    /// Boxes, those that are switched off too.
    pub const fn len(&self) -> usize {
        self.now.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The box of an index as it was set, also one that is switched off.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        self.now.get(index)
    }

    /// The box of an index as it was sent: inflated.
    pub fn inflated(&self, index: u32) -> Option<Aabb> {
        self.scene.get(index)
    }

    /// Boxes set and sent so far.
    pub const fn stats(&self) -> MarginedSceneStats {
        self.stats
    }

    /// Bytes that this process keeps of the scene.
    pub fn allocated_bytes(&self) -> usize {
        self.scene.allocated_bytes()
            + self.now.allocated_bytes()
            + self.outgoing.allocated_bytes()
            + self.pairs.allocated_bytes()
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    pub fn daemon_bytes(&self) -> u64 {
        self.scene.daemon_bytes()
    }
}
