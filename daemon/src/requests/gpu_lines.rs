//! Frames that a GPU works on, in the order in which they were begun.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use crate::execute::{CullUnderWay, SUBMISSIONS, SharedGpu};
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
}

impl GpuLine {
    pub(super) fn new(gpu: Arc<SharedGpu>) -> Self {
        let under_way = Mutex::new(VecDeque::with_capacity(SUBMISSIONS));
        Self { gpu, under_way, claimed: AtomicUsize::new(0) }
    }

    pub(super) fn is_busy(&self) -> bool {
        self.claimed.load(Ordering::Relaxed) > 0
    }

    /// Claims a place for a submission, if one is free.
    pub(super) fn claim_slot(&self) -> bool {
        let claim = |count| (count < SUBMISSIONS).then_some(count + 1);
        self.claimed.fetch_update(Ordering::Relaxed, Ordering::Relaxed, claim).is_ok()
    }

    /// Gives a place back that was claimed: its submission has ended, or was never made.
    pub(super) fn give_slot_back(&self) {
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
