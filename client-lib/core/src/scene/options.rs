//! What a scene may hold, and how many threads it may use.

/// Most boxes that a scene may be allowed: places in cells, four in a block, are counted in 32 bits, and
/// blocks may be twice as many as boxes.
pub(super) const MOST_BOXES: u32 = 1 << 29;

/// What a scene may hold, and how many threads it may use.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SceneOptions {
    /// Indices are below this. At most 2^29; unless set, 2^24.
    pub most_boxes: u32,
    /// Most threads of an edit or query, of the caller's rayon pool; `None` is all of them, or the session's. With one,
    /// no pool is touched.
    pub threads: Option<usize>,
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
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self { most_boxes: 1 << 24, threads: None }
    }
}
