//! The choice of stores and threads.

use super::BoxSource;
use crate::aabb::AABB_BYTES;

/// Fewest bytes of a frame that are written by non-temporal stores.
///
/// Two Zen 4 cores with 1 MiB of second-level and 32 MiB of third-level cache, three frames in turns:
/// at 4 MB both kinds take as long, at 8 MB non-temporal stores take half the time, at 2.4 MB one and a
/// half times. An engine on the CPU reads a smaller frame out of the caches, if it was written through
/// them. With less, frames that fit into the caches are sent to memory and back; with more, lines
/// that nobody will find in a cache are read before they are written.
pub(super) const STREAMED_BYTES: usize = 8 << 20;

/// Fewest boxes of a task that copies or computes a few floats a box: 10 to 40 µs of work.
///
/// A thread of the pool that sleeps needs 50 to 100 µs to begin. With less, tasks cost more than they
/// save; with more, a frame of 100,000 boxes (2.4 MB) has too few tasks for eight threads.
pub(super) const COPIED_TASK_BOXES: usize = 16_384;

/// Boxes of a part are a multiple of this: eight boxes fill three cache lines.
const LINE_BOXES: usize = 8;

/// How a store gets into memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stores {
    /// Through the caches.
    Cached,
    /// Past the caches, a line at once. On processors without such stores as [`Stores::Cached`].
    Streaming,
}

impl Stores {
    /// The stores for a frame of `n` boxes.
    pub const fn of(n: usize) -> Self {
        if n.saturating_mul(AABB_BYTES) >= STREAMED_BYTES { Self::Streaming } else { Self::Cached }
    }
}

/// How the boxes of a frame are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Way {
    /// The stores.
    pub stores: Stores,
    /// Boxes of a part; 0 counts as 1. One part is written by the calling thread, several by its rayon pool.
    pub part_boxes: usize,
}

impl Way {
    /// The way to write `n` boxes of a source on up to `threads` threads.
    pub fn of<S: BoxSource + ?Sized>(n: usize, threads: usize) -> Self {
        let parts = if threads > 1 { n.div_ceil(S::TASK_BOXES.max(1)) } else { 1 };
        let part_boxes = match parts {
            0 | 1 => n.max(1),
            _ => n.div_ceil(parts).next_multiple_of(LINE_BOXES),
        };
        Self { stores: Stores::of(n), part_boxes }
    }
}
