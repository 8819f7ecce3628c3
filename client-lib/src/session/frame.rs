//! A frame being filled.

use std::sync::Arc;

use super::core::Core;
use super::error::FrameError;
use super::link::SharedFrame;
use super::pending::PendingFrame;
use crate::aabb::Aabb;
use crate::precision::{BoxForm, ExpandScratch, Precision, Widening};
use crate::transport::{boxes_in, boxes_in_mut, bytes_in_mut, narrow_boxes_in};
use crate::units::BoxCount;

/// Memory for the boxes of one frame.
///
/// [`boxes_mut`](Frame::boxes_mut) is a plain slice in object order: index it, iterate it, hand
/// chunks of it to rayon, or let [`update`](crate::update) write into it.
pub struct Frame {
    n: BoxCount,
    memory: Option<FrameMemory>,
    written: Written,
    core: Arc<Core>,
}

/// In which form the boxes of a frame are written, and what that may add.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written {
    pub form: BoxForm,
    pub widening: Widening,
}

impl Written {
    pub(super) fn by(precision: &Precision) -> Self {
        Self { form: precision.form(), widening: precision.widening() }
    }
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
    /// In shared memory, in the form of the frame.
    Shared(SharedFrame),
    /// Here. Boxes of a narrow form lie here as the f32 boxes that stand for them.
    Own(Vec<Aabb>),
}

impl FrameMemory {
    /// The boxes to be culled; shared ones of a narrow form are expanded into `scratch`.
    pub(super) fn boxes<'a>(
        &'a self,
        n: BoxCount,
        form: BoxForm,
        scratch: &'a mut ExpandScratch,
    ) -> &'a [Aabb] {
        match self {
            Self::Shared(shared) => narrow_boxes_in(shared.loan.payload(), 0, form, n)
                .map_or(&[], |boxes| boxes.expand(scratch, true)),
            Self::Own(boxes) => boxes,
        }
    }
}

/// Memory that boxes of a narrow form are written into.
pub(super) enum NarrowMemory<'a> {
    /// In their form.
    Bytes(&'a mut [u8]),
    /// As the boxes that stand for them.
    Expanded(&'a mut [Aabb]),
}

impl Frame {
    pub(super) const fn new(
        n: BoxCount,
        memory: FrameMemory,
        written: Written,
        core: Arc<Core>,
    ) -> Self {
        Self { n, memory: Some(memory), written, core }
    }

    /// The memory of a frame whose boxes are written in a narrow form.
    pub(super) fn narrow_memory(&mut self) -> NarrowMemory<'_> {
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                let bytes =
                    bytes_in_mut(shared.loan.payload_mut(), self.written.form.bytes(self.n));
                NarrowMemory::Bytes(bytes.unwrap_or_default())
            }
            Some(FrameMemory::Own(boxes)) => NarrowMemory::Expanded(boxes),
            None => NarrowMemory::Bytes(&mut []),
        }
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
        match &self.memory {
            Some(FrameMemory::Shared(shared)) => {
                boxes_in(shared.loan.payload(), 0, self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(boxes)) => boxes,
            None => &[],
        }
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
                PendingFrame::send(shared, self.n, self.written, Arc::clone(&self.core))
            }
            Some(FrameMemory::Own(boxes)) => {
                let mask = self.core.cull_here(&boxes, self.written);
                self.memory = Some(FrameMemory::Own(boxes));
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
