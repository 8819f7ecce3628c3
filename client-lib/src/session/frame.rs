//! A frame being filled.

use std::sync::Arc;

use super::core::Core;
use super::error::FrameError;
use super::link::SharedFrame;
use super::pending::PendingFrame;
use crate::aabb::Aabb;
use crate::transport::{boxes_in, boxes_in_mut};
use crate::units::BoxCount;

/// Memory for the boxes of one frame.
///
/// [`boxes_mut`](Frame::boxes_mut) is a plain slice in object order: index it, iterate it, hand
/// chunks of it to rayon, or let [`update`](crate::update) write into it.
pub struct Frame {
    n: BoxCount,
    memory: Option<FrameMemory>,
    core: Arc<Core>,
}

impl std::fmt::Debug for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frame")
            .field("n", &self.n)
            .field("is_shared", &self.is_shared())
            .finish_non_exhaustive()
    }
}

/// Where the boxes lie.
pub(super) enum FrameMemory {
    Shared(SharedFrame),
    Own(Vec<Aabb>),
}

impl FrameMemory {
    pub(super) fn boxes(&self, n: BoxCount) -> &[Aabb] {
        match self {
            Self::Shared(shared) => boxes_in(shared.loan.payload(), 0, n).unwrap_or_default(),
            Self::Own(boxes) => boxes,
        }
    }
}

impl Frame {
    pub(super) const fn new(n: BoxCount, memory: FrameMemory, core: Arc<Core>) -> Self {
        Self { n, memory: Some(memory), core }
    }

    /// Boxes in this frame.
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Whether the boxes lie in shared memory.
    pub const fn is_shared(&self) -> bool {
        matches!(self.memory, Some(FrameMemory::Shared(_)))
    }

    /// The boxes, contents unspecified until written.
    pub fn boxes_mut(&mut self) -> &mut [Aabb] {
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                boxes_in_mut(shared.loan.payload_mut(), self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(boxes)) => boxes,
            None => &mut [],
        }
    }

    /// The boxes as written so far.
    pub fn boxes(&self) -> &[Aabb] {
        self.memory.as_ref().map_or(&[], |m| m.boxes(self.n))
    }

    /// The boxes as six floats each: `min.x min.y min.z max.x max.y max.z`.
    pub fn raw_mut(&mut self) -> &mut [[f32; 6]] {
        bytemuck::cast_slice_mut(self.boxes_mut())
    }

    /// Asks for the pairs. In process they are found before this returns.
    ///
    /// # Errors
    /// [`FrameError`]; the frame is given up then.
    pub fn submit(mut self) -> Result<PendingFrame, FrameError> {
        match self.memory.take() {
            Some(FrameMemory::Shared(shared)) => {
                PendingFrame::send(shared, self.n, Arc::clone(&self.core))
            }
            Some(own) => {
                let mask = self.core.cull_here(own.boxes(self.n));
                self.memory = Some(own);
                Ok(PendingFrame::ready(mask?, Arc::clone(&self.core)))
            }
            None => Err(FrameError::TooManyFrames),
        }
    }
}

impl Drop for Frame {
    fn drop(&mut self) {
        if let Some(FrameMemory::Own(boxes)) = self.memory.take() {
            self.core.local().give_boxes(boxes);
        }
    }
}
