//! Frames of several clients in one submission.
//!
//! A small frame does not fill a GPU: its stages wait for each other, and for the link. In a bundle the
//! same stage of all frames runs between the same two barriers. Each frame keeps its own workspace, so
//! the stages know nothing of bundles.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::execute::gpu::device::{Gpu, Order};
use crate::execute::gpu::error::GpuError;
use crate::execute::gpu::frame::{Command, Frame, Wait};

/// A submission that several workspaces wait for.
#[derive(Clone)]
pub(super) struct Bundle(Arc<Mutex<Submission>>);

struct Submission {
    frame: Frame,
    /// Whether it did not end when it was waited for: to wait for it once more would take as long again.
    is_given_up: bool,
}

impl Bundle {
    /// An empty one.
    pub(super) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let frame = Frame::new(gpu, false)?;
        Ok(Self(Arc::new(Mutex::new(Submission { frame, is_given_up: false }))))
    }

    /// Whether no workspace waits for it, so that it may be submitted again.
    pub(super) fn is_free(&self) -> bool {
        Arc::strong_count(&self.0) == 1 && !self.lock().frame.is_pending()
    }

    /// Submits the steps of several frames.
    pub(super) fn submit(&self, frames: Vec<Vec<Command>>) -> Result<(), GpuError> {
        let mut submission = self.lock();
        submission.frame.record_side_by_side(frames)?;
        submission.frame.submit_in(Order::Alone)
    }

    pub(super) fn has_ended(&self) -> bool {
        self.lock().frame.has_ended()
    }

    /// As [`Frame::end`], for the first workspace that asks; the others know at once.
    pub(super) fn end(&self, wait: Wait, patience: Duration) -> Result<(), GpuError> {
        let mut submission = self.lock();
        if submission.is_given_up {
            return Err(GpuError::Lost);
        }
        let ended = submission.frame.end(wait, patience);
        submission.is_given_up = submission.frame.is_pending();
        // Imported memory is kept no longer than its frame needs it.
        submission.frame.forget_steps();
        ended
    }

    /// As [`Frame::settle`], once.
    pub(super) fn settle(&self) -> bool {
        let mut submission = self.lock();
        if !submission.is_given_up {
            submission.is_given_up = !submission.frame.settle();
            submission.frame.forget_steps();
        }
        !submission.is_given_up
    }

    /// The submission, for as long as the guard lives. One thread uses an engine and its frames; after a
    /// panic the frames are given up.
    fn lock(&self) -> MutexGuard<'_, Submission> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
