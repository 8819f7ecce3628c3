//! What a scene may hold, how many threads it may use, and whether its boxes have margins.

use crate::precision::Margin;

/// Most boxes that a scene may be allowed: places in cells, four in a block, are counted in 32 bits, and
/// blocks may be twice as many as boxes.
pub(super) const MOST_BOXES: u32 = 1 << 29;

/// What a scene may hold, how many threads it may use, and whether its boxes have margins.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SceneOptions {
    /// Indices are below this. At most 2^29; unless set, 2^24.
    pub most_boxes: u32,
    /// Most threads of an edit or query, of the caller's rayon pool; `None` is all of them, or the session's. With one,
    /// no pool is touched.
    pub threads: Option<usize>,
    /// Margins of boxes; `None` unless set. They are the client's, who sends fewer boxes: a [`Scene`](super::Scene)
    /// holds the boxes that it is given.
    pub margins: Option<SceneMargins>,
}

impl SceneOptions {
    /// The same with other [`most_boxes`](Self::most_boxes).
    #[must_use]
    pub const fn with_most_boxes(self, most_boxes: u32) -> Self {
        Self { most_boxes, ..self }
    }

    /// The same with no more boxes than a scene may be allowed.
    #[must_use]
    pub fn within_limits(self) -> Self {
        self.with_most_boxes(self.most_boxes.min(MOST_BOXES))
    }

    /// The same with so many [`threads`](Self::threads).
    #[must_use]
    pub const fn with_threads(self, threads: usize) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// The same with boxes that have margins.
    #[must_use]
    pub const fn with_margins(self, pairs: MarginedPairs, usual: Margin) -> Self {
        Self { margins: Some(SceneMargins { pairs, usual }), ..self }
    }
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self { most_boxes: 1 << 24, threads: None, margins: None }
    }
}

/// Margins of a scene's boxes: a box is inflated by its margin when it is sent, and is sent again only when it no
/// longer lies within what was sent, or has become so small that a face of that lies farther outward than four
/// margins. A box with a margin of 0 is sent as it is, whenever it changes. An edit that sends no box, removes
/// nothing and changes no flag and no filter data makes no request to the daemon.
///
/// Memory of this process, beside that of the scene without: 25 bytes for each index. With exact pairs 50
/// bytes for each index, and 8 to 16 for each near pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneMargins {
    /// Which pairs the scene tells.
    pub pairs: MarginedPairs,
    /// The margin of boxes that are set without one.
    pub usual: Margin,
}

/// Which pairs a scene with margins tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MarginedPairs {
    /// Pairs of the inflated boxes: those that overlap, and some that are near. They begin and end as in a scene of
    /// the inflated boxes. On each axis, boxes of such a pair have a gap of at most four times the sum of their
    /// margins and four steps of f32. This process keeps no pairs.
    Near,
    /// Pairs of the boxes as they were set, no more and no less: answers are those of a scene of these boxes, bit by
    /// bit, but for resyncs. This process keeps the near pairs, and an edit tests those around the boxes that it
    /// changes. Where a daemon loses the scene, the next changes are changes all the same; a resync comes only where
    /// there are more changes than pairs, and after the client has asked for one.
    Exact,
}
