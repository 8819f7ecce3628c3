//! Frames of the grid that the GPU works on, with the memory that they read and write.
//!
//! A small frame does not fill a GPU: its stages wait for each other, and for the link. In a bundle the
//! same stage of all frames runs between the same two barriers. Each frame keeps its own workspace, so
//! the stages know nothing of bundles.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use pairmask_core::engine::{CullError, ReplyBuffer};
use pairmask_core::objects::Objects;

use super::ENGINE;
use super::workspace::Workspace;
use crate::execute::FrameMemory;
use crate::execute::frame_memory::{LentReply, with_lent};
use crate::execute::gpu::{Command, Frame, Gpu, GpuError, Order};
use crate::locked;

/// A workspace that its engine and the frame in it share. The frame outlives the engine where it must. One thread uses
/// an engine and its frames, so no thread waits for the lock; after a panic the frame is given up with all that it had.
pub(super) type SharedWorkspace = Arc<Mutex<Workspace>>;

/// A frame under way. Owns the memory that the GPU reads and writes, and gives it back when the GPU is
/// done, to [`Grid::end`](super::Grid::end) or to its own drop, which waits as well. Where the GPU is
/// never done, the memory stays with it ([`FrameMemory::abandon`]).
///
/// The engine may be dropped before.
#[must_use = "dropping a frame under way waits for it and loses its answer"]
pub struct GridUnderWay<M: FrameMemory> {
    workspace: SharedWorkspace,
    memory: Option<M>,
    pub(in crate::execute) lent: LentReply,
}

impl<M: FrameMemory> GridUnderWay<M> {
    /// Takes a free workspace and the memory of its next frame, which [`Self::with`] starts.
    pub(super) fn new(workspace: SharedWorkspace, memory: M) -> Self {
        Self { workspace, memory: Some(memory), lent: LentReply::default() }
    }

    pub(super) fn with<R>(
        &mut self,
        work: impl FnOnce(&mut Workspace, Objects<'_>, &mut dyn ReplyBuffer) -> Result<R, CullError>,
    ) -> Result<R, CullError> {
        let lost = CullError::DeviceLost { engine: ENGINE };
        let memory = self.memory.as_mut().ok_or(lost)?;
        let mut workspace = locked(&self.workspace);
        with_lent(memory, &mut self.lent, |objects, reply| work(&mut workspace, objects, reply))
    }

    pub(super) fn is_in(&self, workspace: &SharedWorkspace) -> bool {
        Arc::ptr_eq(&self.workspace, workspace)
    }

    /// Whether the GPU is done with it, or never will be: ending it does not wait.
    pub fn has_ended(&self) -> bool {
        locked(&self.workspace).has_ended()
    }

    /// Waits for the GPU and takes the memory back; `None` where the GPU keeps it.
    pub fn give_up(mut self) -> Option<M> {
        self.take_back()
    }

    fn take_back(&mut self) -> Option<M> {
        let is_free = locked(&self.workspace).give_up();
        let memory = self.memory.take()?;
        if is_free {
            return Some(memory);
        }
        log::error!("a GPU frame never ended; its request and reply are left to the device");
        memory.abandon();
        None
    }
}

impl<M: FrameMemory> Drop for GridUnderWay<M> {
    fn drop(&mut self) {
        if self.memory.is_some() {
            drop(self.take_back());
        }
    }
}

#[derive(Clone)]
pub(super) struct Bundle(Arc<Mutex<Submission>>);

struct Submission {
    frame: Frame,
    /// Whether it did not end when it was waited for: to wait for it once more would take as long again.
    is_given_up: bool,
}

impl Bundle {
    pub(super) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let frame = Frame::new(gpu, false)?;
        Ok(Self(Arc::new(Mutex::new(Submission { frame, is_given_up: false }))))
    }

    /// Whether no workspace waits for it, so that it may be submitted again.
    pub(super) fn is_free(&self) -> bool {
        Arc::strong_count(&self.0) == 1 && !locked(&self.0).frame.is_pending()
    }

    pub(super) fn submit(&self, frames: Vec<Vec<Command>>) -> Result<(), GpuError> {
        let mut submission = locked(&self.0);
        submission.frame.record_side_by_side(frames)?;
        submission.frame.submit_in(Order::default())
    }

    pub(super) fn has_ended(&self) -> bool {
        locked(&self.0).frame.has_ended()
    }

    /// As [`Frame::end`], for the first workspace that asks; the others know at once.
    pub(super) fn end(&self, timeout: Duration) -> Result<(), GpuError> {
        let mut submission = locked(&self.0);
        if submission.is_given_up {
            return Err(GpuError::Lost);
        }
        let ended = submission.frame.end(timeout);
        submission.is_given_up = submission.frame.is_pending();
        // Imported memory is kept no longer than its frame needs it.
        submission.frame.discard_steps();
        ended
    }

    /// As [`Frame::settle`], once.
    pub(super) fn settle(&self) -> bool {
        let mut submission = locked(&self.0);
        if !submission.is_given_up {
            submission.is_given_up = !submission.frame.settle();
            submission.frame.discard_steps();
        }
        !submission.is_given_up
    }
}
