//! A frame whose boxes are written in a narrow form.

use std::sync::Arc;

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::Rules;
use pairmask_core::precision::{BoxForm, Encoder, Precision};
use pairmask_core::units::BoxCount;
use pairmask_core::write::BoxSource;

use super::error::FrameError;
use super::frame::{Filling, NarrowMemory};
use super::pending::PendingFrame;

/// Memory for the boxes of one frame, written box by box or all at once in the form of a
/// [`Precision`].
///
/// Shared memory holds the narrow form; no f32 boxes are kept. A frame in process holds f32 boxes
/// that are rounded in the same way, so that the answer is the same.
#[derive(Debug)]
pub struct NarrowFrame {
    filling: Filling<Aabb>,
    precision: Precision,
    encoder: Encoder,
}

impl NarrowFrame {
    pub(super) fn new(filling: Filling<Aabb>, precision: Precision) -> Self {
        Self { filling, precision, encoder: Encoder::new(&precision) }
    }

    /// Boxes in this frame.
    pub const fn n(&self) -> BoxCount {
        self.filling.n()
    }

    /// Whether the boxes lie in shared memory.
    pub const fn is_shared(&self) -> bool {
        self.filling.is_shared()
    }

    /// The precision that they are written with: the one asked for, or exact where the daemon does
    /// not know that.
    pub const fn precision(&self) -> &Precision {
        &self.precision
    }

    /// The form of the boxes.
    pub const fn form(&self) -> BoxForm {
        self.precision.form()
    }

    /// Writes box `index`. All boxes together are written faster by [`fill`](Self::fill).
    ///
    /// # Panics
    /// When there is no box of that index.
    #[inline]
    pub fn set(&mut self, index: usize, b: &Aabb) {
        let box_bytes = self.form().box_bytes();
        match self.filling.narrow_memory() {
            NarrowMemory::Bytes(bytes) => {
                self.encoder.write_one(b, &mut bytes[index * box_bytes..][..box_bytes]);
            }
            NarrowMemory::Expanded(boxes) => {
                self.encoder.write_expanded(std::slice::from_ref(b), &mut boxes[index..=index]);
            }
        }
    }

    /// Writes every box, large scenes on the rayon pool: a slice, or what [`Frame::write`] takes.
    ///
    /// [`Frame::write`]: super::frame::Frame::write
    ///
    /// # Panics
    /// When `boxes` are not as many as the frame has.
    pub fn fill(&mut self, boxes: &(impl BoxSource + Sync + ?Sized)) {
        assert_eq!(boxes.len(), self.n().len(), "as many boxes as the frame has");
        match self.filling.narrow_memory() {
            NarrowMemory::Bytes(bytes) => self.encoder.write(boxes, bytes),
            NarrowMemory::Expanded(out) => self.encoder.write_expanded(boxes, out),
        }
    }

    /// Asks for the pairs. In process they are found before this returns.
    ///
    /// # Errors
    /// [`FrameError`]; the frame's memory is gone then.
    pub fn submit(self) -> Result<PendingFrame, FrameError> {
        self.filling.submit()
    }

    /// As [`Frame::submit_between`].
    ///
    /// [`Frame::submit_between`]: super::frame::Frame::submit_between
    ///
    /// # Errors
    /// As [`Frame::submit_between`].
    pub fn submit_between(self, first: BoxCount) -> Result<PendingFrame, FrameError> {
        self.filling.submit_between(first)
    }

    /// As [`Frame::submit_with`].
    ///
    /// [`Frame::submit_with`]: super::frame::Frame::submit_with
    ///
    /// # Errors
    /// As [`Frame::submit_with`].
    pub fn submit_with(self, rules: &Rules) -> Result<PendingFrame, FrameError> {
        self.filling.submit_with(rules)
    }

    /// As [`Frame::submit_with_kept`].
    ///
    /// [`Frame::submit_with_kept`]: super::frame::Frame::submit_with_kept
    ///
    /// # Errors
    /// As [`Frame::submit_with_kept`].
    pub fn submit_with_kept(self, rules: &Arc<Rules>) -> Result<PendingFrame, FrameError> {
        self.filling.submit_with_kept(rules)
    }
}
