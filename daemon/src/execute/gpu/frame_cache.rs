//! Recorded frames, kept for the next frame of the same shape.

use std::sync::Arc;

use pairmask_core::{Encoding, ObjectForm};

use super::{Block, Command, Frame, Gpu, GpuError, Part, QueueRole};

/// A place in a block. The frame that is filed under it keeps the block alive, so its address
/// names no other block meanwhile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BlockOffset {
    block: usize,
    offset: u64,
}

impl BlockOffset {
    pub(super) fn of(part: &Part) -> Self {
        Self { block: Arc::as_ptr(&part.block) as usize, offset: part.offset }
    }

    pub(super) fn is_in(self, block: &Arc<Block>) -> bool {
        self.block == Arc::as_ptr(block) as usize
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FrameKey {
    pub(super) n: u32,
    pub(super) form: ObjectForm,
    pub(super) encoding: Encoding,
    pub(super) capacity: u64,
    /// Which part of a long run it is.
    pub(super) chunk: usize,
    pub(super) input: BlockOffset,
    pub(super) output: BlockOffset,
    pub(super) rules: Option<BlockOffset>,
}

impl FrameKey {
    pub(super) fn uses(&self, block: &Arc<Block>) -> bool {
        self.input.is_in(block) || self.output.is_in(block)
    }
}

/// Frames by key. A client alternates among a few loans for its boxes and a few for the reply.
const CACHED_FRAMES: usize = 16;

/// The last frames used, the most recent last.
pub(super) struct FrameCache<K = FrameKey> {
    role: QueueRole,
    frames: Vec<(K, Frame)>,
}

impl<K: PartialEq> FrameCache<K> {
    pub(super) const fn new(role: QueueRole) -> Self {
        Self { role, frames: Vec::new() }
    }

    pub(super) fn frame(
        &mut self,
        gpu: &Arc<Gpu>,
        key: K,
        profiled: bool,
        steps: impl FnOnce() -> Result<Vec<Command>, GpuError>,
    ) -> Result<&mut Frame, GpuError> {
        if let Some(put) = self.frames.iter().position(|(k, _)| *k == key) {
            let found = self.frames.remove(put);
            self.frames.push(found);
        } else {
            let mut frame = if self.frames.len() < CACHED_FRAMES {
                Frame::of_role(gpu, self.role, profiled)?
            } else {
                self.frames.remove(0).1
            };
            frame.record(steps()?)?;
            self.frames.push((key, frame));
        }
        // One was pushed just now.
        self.frames.last_mut().map(|(_, frame)| frame).ok_or(GpuError::Lost)
    }

    pub(super) fn last(&self) -> Option<&Frame> {
        self.frames.last().map(|(_, frame)| frame)
    }

    pub(super) fn last_mut(&mut self) -> Option<&mut Frame> {
        self.frames.last_mut().map(|(_, frame)| frame)
    }

    /// Waits for frames that are under way. Whether the device is done with all of them.
    pub(super) fn settle(&mut self) -> bool {
        self.frames.iter_mut().fold(true, |settled, (_, frame)| frame.settle() && settled)
    }

    pub(super) fn clear(&mut self) {
        self.frames.clear();
    }

    /// Drops the frames of some keys, but for one under way, which keeps its blocks alive.
    pub(super) fn discard(&mut self, is_meant: impl Fn(&K) -> bool) {
        self.frames.retain(|(key, frame)| frame.is_pending() || !is_meant(key));
    }
}
