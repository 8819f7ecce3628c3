//! What the worker threads share to agree on who serves what.

use std::time::{Duration, Instant};

use pairmask_core::pacing::{Pacing, Wake};
use pairmask_transport::Sender;

use super::workers::Workers;
use crate::clients::{FrameWork, GpuNeed};
use crate::execute::BUNDLE_FRAMES;
use crate::ingest::{Incoming, RequestQueue, Resource};

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

#[derive(Debug)]
pub(super) struct Arrived {
    pub(super) incoming: Incoming,
    pub(super) expected: FrameWork,
}

#[derive(Debug)]
pub(super) struct Task {
    pub(super) incoming: Incoming,
    /// Other small frames for the GPU, which go there with it.
    pub(super) beside: Vec<Incoming>,
    pub(super) threads: usize,
    /// Its session needs no thread of its own: frames of the pool, or of the GPU, wait for each other.
    pub(super) has_turns: bool,
    pub(super) wake: Option<usize>,
}

/// Requests that wait, and who is awake. Every call is short.
#[derive(Debug)]
pub(super) struct Scheduler {
    pub(super) queue: RequestQueue<Arrived>,
    pub(super) workers: Workers,
    spin_policy: SpinPolicy<u64>,
    pub(super) sleep_at: Instant,
    pool_threads: usize,
    pub(super) tasks: u64,
}

impl Scheduler {
    pub(super) fn new(
        queue: RequestQueue<Arrived>,
        workers: Workers,
        spin: Duration,
        pool_threads: usize,
    ) -> Self {
        Self {
            queue,
            workers,
            spin_policy: SpinPolicy::new(spin),
            sleep_at: Instant::now(),
            pool_threads,
            tasks: 0,
        }
    }

    /// Whether a session that was active a moment ago, and may ask again, is not being served.
    pub(super) fn is_awaiting(&self, now: Instant) -> bool {
        self.workers
            .sessions_within(Duration::ZERO, now)
            .any(|session| !self.queue.is_served(session))
    }

    pub(super) fn put(&mut self, arrived: Arrived, now: Instant) {
        let sender = arrived.incoming.sender;
        let resource = resource_for(&arrived.expected);
        if resource == Resource::Core {
            self.workers.note_active(sender.session, now);
        }
        self.queue.put(sender, resource, arrived, now);
    }

    /// The request whose turn it is, and how a thread is to serve it, which begins now. The last one that is not away
    /// with a long frame begins none.
    pub(super) fn next(&mut self, thread: usize, now: Instant) -> Option<Task> {
        let may_be_away = self.workers.may_be_away();
        let may_be_served = |arrived: &Arrived| may_be_away || arrived.expected.work <= LONG_FRAME;
        // Another client's frame may take seconds: to wait longer than it would take on a core is no gain.
        let too_long = |arrived: &Arrived, waited| waited > arrived.expected.work;
        let (_, resource, Arrived { incoming, expected }) =
            self.queue.next(now, may_be_served, too_long)?;
        let (work, asked) = (expected.work, resource_for(&expected));
        let session = incoming.sender.session;
        self.spin_policy.note_request(session, now);
        let others_within = |time| {
            self.workers.sessions_within(time, now).filter(|other| *other != session).count()
        };
        // Frames of the pool wait for each other, and so leave each other no core. Those of the GPU need
        // none of the pool's threads where others wait.
        let has_turns = asked != Resource::Core;
        let others = match resource {
            Resource::Core => {
                others_within(Duration::ZERO).max(self.queue.serving().saturating_sub(1))
            }
            // A client that came within as long as the frame takes may come again meanwhile.
            Resource::Pool => others_within(work),
            Resource::Gpu => others_within(Duration::ZERO).max(self.queue.waiting()),
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
                && let Some((sender, other)) = self.queue.next_beside(now, resource, can_join)
            {
                self.spin_policy.note_request(sender.session, now);
                beside.push(other.incoming);
            }
        }
        Some(Task { incoming, beside, threads, has_turns, wake })
    }

    /// A thread has served all requests of a task, of which this was the first.
    pub(super) fn note_served(
        &mut self,
        thread: usize,
        sender: Sender,
        has_turns: bool,
        now: Instant,
    ) {
        self.workers.end(thread);
        if !has_turns {
            self.workers.note_active(sender.session, now);
        }
        self.note_answer(now);
    }

    pub(super) fn note_answer(&mut self, now: Instant) {
        self.sleep_at = self.spin_policy.note_answer(now);
    }

    /// What the thread that leads does without work, after the time to go to sleep.
    pub(super) fn rest(&mut self, now: Instant) -> Rest {
        match self.spin_policy.rest(now) {
            Rest::Sleep { until } if self.is_waited() => {
                Rest::Sleep { until: until.min(now + WAITING_LOOK) }
            }
            rest => rest,
        }
    }

    /// Whether requests wait, for what is taken.
    pub(super) fn is_waited(&self) -> bool {
        self.queue.waiting() > 0
    }
}

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

/// A client that came back within this time is waited for as long. Spinning for a gap costs as much of a core as the gap is long, and spares what a
/// wake-up takes on both sides, 40 to 100 µs, and the sleep of the engines' threads.
const LONGEST: Duration = Duration::from_millis(1);
/// A gap is waited for until it is so many times as long as the last one.
const ROOM: u32 = 2;
/// The longest sleep: how soon a stop signal, a request without a wake-up and the end of a client
/// are noticed at the latest. Two wake-ups a second cost nothing that can be measured.
pub(super) const LONGEST_SLEEP: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rest {
    /// Look for requests all the time: a client that was answered may come back at once, or a client's next frame is
    /// due before that time.
    Spin {
        until: Instant,
    },
    Sleep {
        until: Instant,
    },
}

/// Learns from the last gap between an answer and the next request how long the next one may be, and
/// from each client's requests when its next one is due. `C` distinguishes clients.
#[derive(Clone, Debug)]
pub(super) struct SpinPolicy<C> {
    least: Duration,
    answered_at: Option<Instant>,
    gap: Duration,
    spin_until: Option<Instant>,
    pacing: Pacing<C>,
    /// The next time to be awake, as far as it was computed.
    wake: Option<Wake>,
}

impl<C: PartialEq> SpinPolicy<C> {
    /// Waits for `least` regardless of the gaps; where that is nothing, never spins.
    pub(super) fn new(least: Duration) -> Self {
        Self {
            least,
            answered_at: None,
            gap: Duration::ZERO,
            spin_until: None,
            pacing: Pacing::default(),
            wake: None,
        }
    }

    pub(super) fn note_request(&mut self, client: C, now: Instant) {
        // Several may come between two answers: the first ended the gap.
        if let Some(answered_at) = self.answered_at.take() {
            self.gap = now.saturating_duration_since(answered_at);
        }
        self.pacing.note_request(client, now);
        self.wake = None;
    }

    /// A request was answered. Returns until when to spin for the next one.
    pub(super) fn note_answer(&mut self, now: Instant) -> Instant {
        self.answered_at = Some(now);
        let longest = LONGEST.max(self.least);
        let spin_policy = if self.least.is_zero() || self.gap > longest {
            self.least
        } else {
            (self.gap * ROOM).clamp(self.least, longest)
        };
        let until = now + spin_policy;
        self.spin_until = Some(until);
        until
    }

    pub(super) fn rest(&mut self, now: Instant) -> Rest {
        if let Some(until) = self.spin_until.filter(|until| now < *until) {
            return Rest::Spin { until };
        }
        let longest = now + LONGEST_SLEEP;
        if self.least.is_zero() {
            return Rest::Sleep { until: longest };
        }
        if self.wake.is_none_or(|wake| wake.spin_until <= now) {
            self.wake = self.pacing.next_wake(now);
        }
        match self.wake {
            Some(wake) if wake.is_awake(now) => Rest::Spin { until: wake.spin_until },
            Some(wake) => Rest::Sleep { until: wake.sleep_until.min(longest) },
            None => Rest::Sleep { until: longest },
        }
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

    const US: Duration = Duration::from_micros(1);
    const MS: Duration = Duration::from_millis(1);

    /// Timeout after a gap of so many µs.
    fn after(least: Duration, gap: u32) -> Duration {
        let mut spin_policy = SpinPolicy::new(least);
        let start = Instant::now();
        assert_eq!(spin_policy.note_answer(start), start + least);
        spin_policy.note_request(1, start + gap * US);
        spin_policy.note_request(1, start + 2 * gap * US);
        let answered = start + 3 * gap * US;
        spin_policy.note_answer(answered) - answered
    }

    #[test]
    fn waits_for_those_who_come_soon() {
        assert_eq!(after(50 * US, 0), 50 * US);
        assert_eq!(after(50 * US, 100), 200 * US);
        assert_eq!(after(50 * US, 600), 1000 * US);
        assert_eq!(after(50 * US, 1000), 1000 * US);
        assert_eq!(after(50 * US, 1001), 50 * US);
        assert_eq!(after(Duration::ZERO, 10), Duration::ZERO);
    }

    /// Timeout after 20 frames, 16 ms each, and when the last of them was answered.
    fn steady(least: Duration) -> (SpinPolicy<u32>, Instant) {
        let mut spin_policy = SpinPolicy::new(least);
        let mut now = Instant::now();
        for _ in 0..20 {
            now += 16 * MS;
            spin_policy.note_request(1, now);
            spin_policy.note_answer(now + 40 * US);
        }
        (spin_policy, now)
    }

    #[test]
    fn is_awake_for_a_steady_client_and_asleep_otherwise() {
        let (mut spin_policy, last) = steady(50 * US);
        assert!(matches!(spin_policy.rest(last + 60 * US), Rest::Spin { .. }));
        let Rest::Sleep { until } = spin_policy.rest(last + 90 * US) else { panic!("it sleeps") };
        assert!(last + 15 * MS < until && until < last + 16 * MS);
        let Rest::Spin { until } = spin_policy.rest(until) else { panic!("it is awake") };
        assert_eq!(spin_policy.rest(last + 16 * MS), Rest::Spin { until });
        assert!(last + 16 * MS < until && until < last + 17 * MS);
        // The frame does not come, nor the next ones.
        let mut now = until;
        let mut spins = 0;
        while now < last + 10_000 * MS {
            now = match spin_policy.rest(now) {
                Rest::Spin { until } => {
                    spins += 1;
                    until
                }
                Rest::Sleep { until } => until,
            };
        }
        assert_eq!(spins, 2, "two more beats are awaited");
    }

    #[test]
    fn never_spins_where_that_is_the_setting() {
        let (mut spin_policy, last) = steady(Duration::ZERO);
        for ms in [0, 15, 16, 17] {
            let now = last + ms * MS + 50 * US;
            assert_eq!(spin_policy.rest(now), Rest::Sleep { until: now + LONGEST_SLEEP });
        }
    }
}
