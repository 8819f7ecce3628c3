//! Memory that a frame reads and writes.
//!
//! A GPU works on a frame while the daemon does something else, so the frame owns its memory until
//! the device is done: a value that can be moved, dropped and dropped without the device ever
//! writing to memory that has another owner by then.
#![allow(unsafe_code)]

use std::sync::Arc;

use pairmask_core::cancel::Wanted;
use pairmask_core::engine::{ReplyBuffer, ReserveError};
use pairmask_core::objects::Objects;
use pairmask_core::precision::BoxSlice;

/// The boxes or spheres of a frame and the memory of its reply, in one value.
///
/// # Safety
/// As long as the value lives, wherever it is moved:
///
/// * [`Self::with`] hands out objects at the same address, as many and of the same form each time.
/// * The memory that the reply lent last stays mapped where it is, and only [`Self::with`] gives
///   references into it, until the reply is asked for memory again or the value is dropped. It stays
///   so for ever when [`Self::abandon`] returns.
///
/// Shared memory that a reply lends is mapped to the same pages as long as the engines live that the
/// value is given to, longer than the value itself: GPUs import it for the frames to come. Who gives its
/// pages back to the system has every GPU let go of them first
/// ([`SharedGpu::release_reply`](super::SharedGpu::release_reply)), while no reply lends them.
pub unsafe trait FrameMemory {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R;

    /// Leaves the memory to a device that may write to it for ever.
    fn abandon(self)
    where
        Self: Sized,
    {
        std::mem::forget(self);
    }
}

/// Memory that the reply of a [`FrameMemory`] lent, by its address. Only [`with_lent`] makes one, so
/// what that trait promises of such memory holds for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LentReply {
    start: usize,
    bytes: usize,
}

impl LentReply {
    pub(super) const fn range(self) -> std::ops::Range<usize> {
        self.start..self.start + self.bytes
    }
}

/// As [`FrameMemory::with`]; notes in `lent` what `work` asked the reply for last, and leaves it as it
/// is where `work` asked for nothing.
pub(super) fn with_lent<M: FrameMemory, R>(
    memory: &mut M,
    lent: &mut LentReply,
    work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R,
) -> R {
    memory.with(|objects, reply| work(objects, &mut NotedReply { inner: reply, lent }))
}

struct NotedReply<'a> {
    inner: &'a mut dyn ReplyBuffer,
    lent: &'a mut LentReply,
}

impl ReplyBuffer for NotedReply<'_> {
    fn limit_words(&self) -> u64 {
        self.inner.limit_words()
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let memory = self.inner.reserve(words)?;
        *self.lent = LentReply { start: memory.as_ptr() as usize, bytes: size_of_val(memory) };
        Ok(memory)
    }

    fn asker(&self) -> Option<Arc<dyn Wanted>> {
        self.inner.asker()
    }
}

pub(crate) fn boxes_of(objects: Objects<'_>) -> BoxSlice<'_> {
    match objects {
        Objects::Boxes(boxes) => boxes,
        // Frames of spheres are run apart, and those with rules or of two sets are refused with the header.
        Objects::Spheres(_) => BoxSlice::default(),
    }
}

/// Objects and a reply that the caller lends for the time of a call. A device that never ends the frame
/// ends the process instead: the call can neither return nor keep what is not its own.
pub(super) struct Borrowed<'a> {
    pub(super) objects: Objects<'a>,
    pub(super) reply: &'a mut dyn ReplyBuffer,
}

// SAFETY: both are borrowed as long as the value lives: the objects do not change their place, and what
// the reply lent can be reached through `reply` alone. `abandon` does not return. It is given to the
// engines themselves, which import nothing; the importer vouches for what they find.
unsafe impl FrameMemory for Borrowed<'_> {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        work(self.objects, self.reply)
    }

    fn abandon(self) {
        end_process()
    }
}

/// Ends a process whose memory a device may write to for ever. In the daemon that is the worker, and
/// the supervisor starts another.
pub(super) fn end_process() -> ! {
    log::error!("a GPU frame never ended, and its reply is borrowed: this process ends");
    std::process::abort()
}
