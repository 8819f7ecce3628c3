//! What the worker threads share to agree on who serves what.

use std::time::{Duration, Instant};

use pairmask_transport::Sender;

use super::patience::{Patience, Rest};
use super::workers::Workers;
use crate::clients::{FrameWork, GpuNeed};
use crate::execute::BUNDLE_FRAMES;
use crate::ingest::{Inbox, Incoming, Resource};

/// A thread that is expected to take longer than this for a frame has another one listen meanwhile. To wake
/// one takes 5 µs; requests that come during a shorter frame wait for its end.
const LONG_FRAME: Duration = Duration::from_micros(300);

/// A frame that is expected to take more work than this, on one core, is large: large frames are served
/// one at a time, by all threads of the engines. Below, a frame has a core to itself: to share it out
/// would gain less than the frames of other clients lose.
const LARGE_WORK: Duration = Duration::from_millis(2);

/// While requests wait, a thread without work looks so often whether one has waited too long for the pool. The system's
/// coarse clock may make 10 ms of it.
const WAITING_LOOK: Duration = Duration::from_millis(1);

/// A request, and the work that is expected of it.
#[derive(Debug)]
pub(super) struct Arrived {
    pub(super) incoming: Incoming,
    pub(super) expected: FrameWork,
}

/// A request that a worker thread is to serve.
#[derive(Debug)]
pub(super) struct Task {
    pub(super) incoming: Incoming,
    /// Other small frames for the GPU, which go there with it.
    pub(super) beside: Vec<Incoming>,
    /// Threads that an engine may use.
    pub(super) threads: usize,
    /// Its session needs no thread of its own: frames of the pool, or of the GPU, wait for each other.
    pub(super) has_turns: bool,
    /// A worker thread to wake.
    pub(super) wake: Option<usize>,
}

/// Requests that wait, and who is awake. Every call is short.
#[derive(Debug)]
pub(super) struct Scheduler {
    inbox: Inbox<Arrived>,
    pub(super) workers: Workers,
    patience: Patience<u128>,
    /// When threads without work go to sleep.
    sleep_at: Instant,
    /// Threads of the engines' pool.
    pool_threads: usize,
    /// Threads that the last task used.
    last_threads: usize,
    /// Tasks that were begun so far.
    tasks: u64,
}

impl Scheduler {
    pub(super) fn new(
        inbox: Inbox<Arrived>,
        workers: Workers,
        spin: Duration,
        pool_threads: usize,
    ) -> Self {
        Self {
            inbox,
            workers,
            patience: Patience::new(spin),
            sleep_at: Instant::now(),
            pool_threads,
            last_threads: 1,
            tasks: 0,
        }
    }

    /// Requests that it has room for.
    pub(super) fn room(&self) -> usize {
        self.inbox.room()
    }

    /// When threads without work go to sleep.
    pub(super) const fn sleep_at(&self) -> Instant {
        self.sleep_at
    }

    /// Whether a session that was active a moment ago is not being served: it may ask again at any
    /// moment.
    pub(super) fn is_awaiting(&self, now: Instant) -> bool {
        self.workers.sessions(now).any(|session| !self.inbox.is_served(session))
    }

    /// Takes in a request.
    pub(super) fn put(&mut self, arrived: Arrived, now: Instant) {
        let sender = arrived.incoming.sender;
        let resource = resource_for(&arrived.expected);
        if resource == Resource::Core {
            self.workers.note_active(sender.session, now);
        }
        self.inbox.put(sender, resource, arrived, now);
    }

    /// The request whose turn it is, and how a thread is to serve it, which begins now. The last one that is not away
    /// with a long frame begins none.
    pub(super) fn next(&mut self, thread: usize, now: Instant) -> Option<Task> {
        let may_be_away = self.workers.may_be_away();
        let may_be_served = |arrived: &Arrived| may_be_away || arrived.expected.work <= LONG_FRAME;
        // Another client's frame may take seconds: to wait longer than it would take on a core is no gain.
        let too_long = |arrived: &Arrived, waited| waited > arrived.expected.work;
        let (_, resource, Arrived { incoming, expected }) =
            self.inbox.next(now, may_be_served, too_long)?;
        let (work, asked) = (expected.work, resource_for(&expected));
        let session = incoming.sender.session;
        self.patience.note_request(session, now);
        let others_within = |time| {
            self.workers.sessions_within(time, now).filter(|other| *other != session).count()
        };
        // Frames of the pool wait for each other, and so leave each other no core. Those of the GPU need
        // none of the pool's threads where others wait.
        let has_turns = asked != Resource::Core;
        let others = match resource {
            Resource::Core => {
                others_within(Duration::ZERO).max(self.inbox.serving().saturating_sub(1))
            }
            // Whoever came within as long as the frame takes may come again meanwhile.
            Resource::Pool => others_within(work),
            Resource::Gpu => others_within(Duration::ZERO).max(self.inbox.waiting()),
        };
        let threads =
            if resource == asked { threads_for(work, others, self.pool_threads) } else { 1 };
        let is_long = work / threads as u32 > LONG_FRAME;
        let wake = self.workers.begin(thread, is_long, now);
        self.tasks += 1;
        let mut beside = Vec::new();
        if expected.gpu == GpuNeed::Shared {
            let can_join = |other: &Arrived| other.expected.gpu == GpuNeed::Shared;
            while beside.len() + 1 < BUNDLE_FRAMES
                && let Some((sender, other)) = self.inbox.next_beside(now, resource, can_join)
            {
                self.patience.note_request(sender.session, now);
                beside.push(other.incoming);
            }
        }
        Some(Task { incoming, beside, threads, has_turns, wake })
    }

    /// A request was served by so many threads, and used so much time of them.
    pub(super) fn note_used(&mut self, sender: Sender, threads: usize, used: Duration) {
        self.last_threads = threads;
        self.inbox.note_served(sender, used);
    }

    /// A thread has served all requests of a task, of which this was the first. Returns when threads without work
    /// go to sleep.
    pub(super) fn note_served(
        &mut self,
        thread: usize,
        sender: Sender,
        has_turns: bool,
        now: Instant,
    ) -> Instant {
        self.workers.end(thread);
        if !has_turns {
            self.workers.note_active(sender.session, now);
        }
        self.note_answer(now);
        self.sleep_at
    }

    /// An answer went out.
    pub(super) fn note_answer(&mut self, now: Instant) {
        self.sleep_at = self.patience.note_answer(now);
    }

    /// What the thread that leads does without work, after the time to go to sleep.
    pub(super) fn rest(&mut self, now: Instant) -> Rest {
        match self.patience.rest(now) {
            Rest::Sleep { until } if self.is_waited() => {
                Rest::Sleep { until: until.min(now + WAITING_LOOK) }
            }
            rest => rest,
        }
    }

    /// Whether requests wait, for what is taken.
    pub(super) fn is_waited(&self) -> bool {
        self.inbox.waiting() > 0
    }

    /// Tasks that were begun so far.
    pub(super) const fn tasks(&self) -> u64 {
        self.tasks
    }

    /// Threads that the last task used.
    pub(super) const fn last_threads(&self) -> usize {
        self.last_threads
    }
}

/// What a frame is to be served by.
fn resource_for(expected: &FrameWork) -> Resource {
    match expected {
        FrameWork { gpu: GpuNeed::Alone | GpuNeed::Shared, .. } => Resource::Gpu,
        FrameWork { work, .. } if *work > LARGE_WORK => Resource::Pool,
        FrameWork { .. } => Resource::Core,
    }
}

/// Threads for a frame of so much work, where so many other sessions are active. One that is alone may
/// have all. Beside others a small frame has one core, and a large one leaves each of them one, half of
/// the machine at the most.
fn threads_for(work: Duration, others: usize, pool_threads: usize) -> usize {
    match others {
        0 => pool_threads,
        _ if work <= LARGE_WORK => 1,
        _ => pool_threads.saturating_sub(others).max(pool_threads.div_ceil(2)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_shared_out() {
        let (small, large) = (LARGE_WORK, LARGE_WORK * 2);
        assert_eq!(threads_for(small, 0, 16), 16);
        assert_eq!(threads_for(small, 1, 16), 1);
        assert_eq!(threads_for(large, 0, 16), 16);
        assert_eq!(threads_for(large, 7, 16), 9);
        assert_eq!(threads_for(large, 30, 16), 8);
        assert_eq!(threads_for(large, 3, 2), 1);
        assert_eq!(threads_for(large, 3, 1), 1);
    }
}
