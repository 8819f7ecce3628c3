//! Frames that a GPU works on, in the order in which they were begun.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::execute::gpu::{DriverThread, Progress};
use crate::execute::{CullUnderWay, SUBMISSIONS_UNDER_WAY, SharedGpu};
use crate::locked;
use crate::publish::OpenRequest;

pub(super) struct Submission {
    pub(super) first: CullUnderWay<OpenRequest>,
    pub(super) others: Vec<CullUnderWay<OpenRequest>>,
}

pub(super) struct GpuLine {
    pub(super) gpu: Arc<SharedGpu>,
    /// Oldest first.
    under_way: Mutex<VecDeque<Submission>>,
    /// Places that are claimed, for those who only look.
    claimed: AtomicUsize,
    /// The thread that takes a device in: the first one, and one that was lost and is back.
    returning: Mutex<Option<DriverThread<()>>>,
}

impl GpuLine {
    pub(super) fn new(gpu: Arc<SharedGpu>) -> Self {
        let under_way = Mutex::new(VecDeque::with_capacity(SUBMISSIONS_UNDER_WAY));
        Self { gpu, under_way, claimed: AtomicUsize::new(0), returning: Mutex::default() }
    }

    /// Gives up what the GPU keeps of clients that are gone. A device that was opened, or was lost and is there again, is
    /// taken in on a thread of its own: nobody waits for it.
    pub(super) fn tidy(&self) {
        if self.gpu.is_there() {
            self.gpu.tidy();
            return;
        }
        if self.gpu.is_missing() {
            return;
        }
        let mut returning = locked(&self.returning);
        if let Some(thread) = returning.as_ref()
            && (matches!(thread.progress(), Progress::UnderWay) || thread.ask())
        {
            return;
        }
        let gpu = Arc::clone(&self.gpu);
        match DriverThread::start("gpu-back", move || gpu.take_back()) {
            Ok(thread) => *returning = Some(thread),
            Err(error) => log::error!("no thread to take the GPU back on: {error}"),
        }
    }

    pub(super) fn is_busy(&self) -> bool {
        self.claimed.load(Ordering::Relaxed) > 0
    }

    /// Claims a place for a submission, if one is free.
    pub(super) fn claim_place(&self) -> bool {
        let claim = |count| (count < SUBMISSIONS_UNDER_WAY).then_some(count + 1);
        self.claimed.fetch_update(Ordering::Relaxed, Ordering::Relaxed, claim).is_ok()
    }

    /// Gives a place back that was claimed: its submission has ended, or was never made.
    pub(super) fn give_place_back(&self) {
        self.claimed.fetch_sub(1, Ordering::Relaxed);
    }

    pub(super) fn put(&self, submission: Submission) {
        locked(&self.under_way).push_back(submission);
    }

    pub(super) fn take_oldest(&self) -> Option<Submission> {
        locked(&self.under_way).pop_front()
    }

    /// The oldest submission if it has ended, and no other thread is about to take it.
    pub(super) fn take_ended(&self) -> Option<Submission> {
        if !self.is_busy() {
            return None;
        }
        let mut under_way = self.under_way.try_lock().ok()?;
        let has_ended = under_way.front().is_some_and(|oldest| oldest.first.has_ended());
        if has_ended { under_way.pop_front() } else { None }
    }
}

impl Drop for GpuLine {
    /// Ends the thread before the device is destroyed, and waits for that.
    fn drop(&mut self) {
        *self.returning.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
    }
}
