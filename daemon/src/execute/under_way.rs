//! Frames that the GPU works on while the daemon does something else.

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::dispatch::CullAnswer;
use pairmask_core::engine::CullError;

use super::gpu::{self, GridUnderWay};
use super::shared_gpu::{Queued, SharedGpu};
use super::{FrameMemory, Owner, Planned};

/// A frame that the GPU works on. Owns its memory; dropped, it waits for the GPU first.
#[derive(Debug)]
pub struct CullUnderWay<M: FrameMemory> {
    pub(super) frame: GridUnderWay<M>,
    pub(super) owner: Owner,
    pub(super) planned: Planned,
    pub(super) queued: Queued,
}

impl<M: FrameMemory> CullUnderWay<M> {
    /// Waits for the frame, and gives its memory back.
    ///
    /// # Errors
    /// The frame, where the GPU could not serve it: [`Executor::answer`](super::Executor::answer) does.
    #[allow(clippy::result_large_err)] // A box would be an allocation.
    pub fn end(self) -> Result<Ended<M>, Unserved<M>> {
        let Self { frame, owner, planned, queued } = self;
        let lost = CullError::DeviceLost { engine: planned.plan.engine };
        let (done, memory) = match &planned.gpu {
            Some(gpu) => gpu.with(|gpu| gpu.end(frame, &planned.plan)),
            None => (Err(lost), frame.give_up()),
        };
        drop(queued);
        match done {
            Ok((report, engine)) => Ok((Ok(planned.answer(report, engine)), memory)),
            Err(error) => Err(Unserved { error, planned, owner, memory }),
        }
    }

    /// Whether it has ended, so that [`Executor::end`](super::Executor::end) does not wait.
    pub fn has_ended(&self) -> bool {
        self.frame.has_ended()
    }
}

/// An answer or its error, with the memory of the frame. The memory is `None` where a device keeps it
/// that never ends the frame: nothing can be answered then.
pub type Ended<M> = (Result<CullAnswer, CullError>, Option<M>);

/// Submissions that may be under way at a time, of one frame or of several.
pub const SUBMISSIONS_UNDER_WAY: usize = gpu::SUBMISSIONS;

/// Most frames of a submission.
pub const BUNDLE_FRAMES: usize = gpu::BUNDLE_FRAMES;

/// A frame that is to share a submission with others: made by [`Executor::join`](super::Executor::join),
/// submitted by [`SharedGpu::begin_bundle`].
#[derive(Debug)]
pub struct Joining<M> {
    pub(super) planned: Planned,
    pub(super) owner: Owner,
    pub(super) memory: M,
}

impl<M> Joining<M> {
    /// The place of the GPU that it is planned for, among those of the daemon.
    pub fn gpu_place(&self) -> usize {
        self.planned.gpu_place()
    }
}

impl SharedGpu {
    /// Gives up what the GPU keeps of clients that are gone; to be called now and then.
    pub fn tidy(&self) {
        self.lock().tidy();
    }

    /// Has the GPU let go of the memory of replies in a range of addresses, none of which is lent. Whether it did:
    /// nothing of it reads or writes there any more.
    pub fn release_reply(&self, range: &Range<usize>) -> bool {
        // One that is being opened has imported nothing, and imports no memory that is not lent.
        self.is_opening() || self.lock().release_reply(range)
    }

    /// Takes a device in that was opened, or was lost and is back. Its engines may take a second to make.
    pub fn take_back(&self) {
        self.with(super::GpuService::take_back);
    }

    /// Leaves frames to the GPU in one submission.
    ///
    /// # Errors
    /// Each frame that the GPU does not take: [`Executor::answer`](super::Executor::answer) serves it.
    ///
    /// # Panics
    /// With more than [`BUNDLE_FRAMES`].
    #[allow(clippy::result_large_err)] // A box would be an allocation.
    pub fn begin_bundle<M: FrameMemory>(
        self: &Arc<Self>,
        frames: Vec<Joining<M>>,
    ) -> Vec<Result<CullUnderWay<M>, Unserved<M>>> {
        let count = frames.len();
        let mut waiting = Vec::with_capacity(count);
        let mut memories = Vec::with_capacity(count);
        for Joining { planned, owner, memory } in frames {
            memories.push((memory, owner, planned.plan.encoding));
            let planned = Planned { gpu: Some(Arc::clone(self)), ..planned };
            waiting.push((self.queue(&planned.plan, count), planned, owner));
        }
        let begun = self.with(|gpu| gpu.begin_bundle(memories));
        waiting
            .into_iter()
            .zip(begun)
            .map(|((queued, planned, owner), begun)| match begun {
                Ok(frame) => Ok(CullUnderWay { frame, owner, planned, queued }),
                Err((error, memory)) => Err(Unserved { error, planned, owner, memory }),
            })
            .collect()
    }
}

/// A frame that the GPU could not serve.
#[derive(Debug)]
pub struct Unserved<M> {
    pub(super) error: CullError,
    pub(super) planned: Planned,
    pub(super) owner: Owner,
    pub(super) memory: Option<M>,
}

impl<M> Unserved<M> {
    /// Threads that the CPU's engines may use for it; `None` leaves it to the plan.
    pub fn threads(&self) -> Option<usize> {
        self.planned.options.threads
    }
}
