//! What the worker threads do, and who of them looks for requests.
//!
//! Each call is one step, made under the scheduler's lock: the leader gives the lead up in the step in which it
//! begins to serve, and a thread is woken by the step that finds it needed. What holds between any two steps, so that
//! no request waits for the end of a long frame:
//!
//! > **Somebody listens.** Unless all threads serve long frames, one of them leads, or is idle and awake and so leads
//! > as soon as nobody does, or serves a frame that is expected to be short, and looks for requests after it.
//!
//! A frame that was expected to be short and is not is noticed by the first thread that rests ([`Workers::relieve`]).

use std::time::{Duration, Instant};

/// A session counts as active so long after its last request or answer. A closed loop comes back within
/// some tens of µs; a game at 240 frames a second is worth a wake-up, not a core.
const ACTIVE_FOR: Duration = Duration::from_millis(2);

/// So long a session is remembered: a client of 10 frames a second comes back within it.
const KNOWN_FOR: Duration = Duration::from_millis(100);

/// A thread that has served a frame for so long, though it was expected to be short, is not waited for any longer.
const OVERDUE: Duration = Duration::from_millis(5);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Activity {
    /// Nothing: it is awake, and looks what to do.
    Idle,
    Leads,
    /// It serves a frame that it began at this time, and is away meanwhile if that is a long one.
    Serves {
        is_long: bool,
        since: Instant,
    },
    Rests,
}

/// What each worker thread does, and how many should be awake: one for each session that asked for small frames a
/// moment ago, and one for each that is away with a long frame.
///
/// Instants come from outside, and who is to be woken is asked to the caller.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Workers {
    /// Sessions and when they were active last.
    seen: Vec<(u64, Instant)>,
    activities: Vec<Activity>,
    /// The most threads that are awake for active sessions.
    most_awake: usize,
}

impl Workers {
    /// So many threads, all awake, for a machine of so many cores: half of them are the clients'.
    pub(super) fn new(threads: usize, cores: usize) -> Self {
        Self {
            seen: Vec::new(),
            activities: vec![Activity::Idle; threads],
            most_awake: (cores / 2).clamp(1, threads.max(1)),
        }
    }

    /// A session has sent a request for a small frame, or was answered one.
    pub(super) fn note_active(&mut self, session: u64, now: Instant) {
        if let Some((_, at)) = self.seen.iter_mut().find(|(seen, _)| *seen == session) {
            *at = now;
        } else {
            self.seen.retain(|(_, at)| is_within(*at, now, KNOWN_FOR));
            self.seen.push((session, now));
        }
    }

    /// Sessions that were active within a time, at least [`ACTIVE_FOR`]: those that may come again during a frame that takes
    /// as long. Some that were active earlier than [`KNOWN_FOR`] are dropped.
    pub(super) fn sessions_within(
        &self,
        time: Duration,
        now: Instant,
    ) -> impl Iterator<Item = u64> {
        let time = time.clamp(ACTIVE_FOR, KNOWN_FOR);
        let is_active = move |(_, at): &&(u64, Instant)| is_within(*at, now, time);
        self.seen.iter().filter(is_active).map(|(session, _)| *session)
    }

    pub(super) fn is_led(&self) -> bool {
        self.activities.contains(&Activity::Leads)
    }

    /// An idle thread leads from now on, unless another one does. Whether it does.
    pub(super) fn lead(&mut self, thread: usize) -> bool {
        let may = !self.is_led();
        if may {
            self.activities[thread] = Activity::Leads;
        }
        may
    }

    /// Whether a thread may begin a long frame: another one is left for short ones.
    pub(super) fn may_be_away(&self) -> bool {
        self.away() + 1 < self.activities.len().max(2)
    }

    /// An idle thread, or the one that leads, serves a frame from now on. Returns a thread to wake, which is idle from
    /// now on; `None` where enough are awake.
    pub(super) fn begin(&mut self, thread: usize, is_long: bool, now: Instant) -> Option<usize> {
        self.activities[thread] = Activity::Serves { is_long, since: now };
        if self.awake() >= self.requested(now) {
            return None;
        }
        let woken = (0..self.activities.len()).find(|thread| self.is_resting(*thread))?;
        self.activities[woken] = Activity::Idle;
        Some(woken)
    }

    /// A thread has served its frame, or leads no longer, and is idle.
    pub(super) fn end(&mut self, thread: usize) {
        self.activities[thread] = Activity::Idle;
    }

    /// Wakes a thread of which it is known that it is needed. Whether it rested.
    pub(super) fn wake(&mut self, thread: usize) -> bool {
        let rested = self.is_resting(thread);
        if rested {
            self.activities[thread] = Activity::Idle;
        }
        rested
    }

    /// An idle thread, or the one that leads, goes to rest, unless no other one would listen. Whether it rests.
    pub(super) fn rest(&mut self, thread: usize) -> bool {
        // Those who are away do not listen.
        let may = self.awake() > self.away() + 1;
        if may {
            self.activities[thread] = Activity::Rests;
        }
        may
    }

    /// A thread that rests has looked up by itself. It is idle from now on if it is the first of them, and all that are
    /// awake serve frames since long. Whether it is.
    pub(super) fn relieve(&mut self, thread: usize, now: Instant) -> bool {
        let is_overdue = |activity: &Activity| match activity {
            Activity::Serves { since, .. } => !is_within(*since, now, OVERDUE),
            Activity::Rests => true,
            Activity::Idle | Activity::Leads => false,
        };
        let is_first = self.is_resting(thread) && self.resting_before(thread) == 0;
        let is_needed = is_first && self.activities.iter().all(is_overdue);
        if is_needed {
            self.activities[thread] = Activity::Idle;
        }
        is_needed
    }

    pub(super) fn is_too_many(&self, now: Instant) -> bool {
        self.awake() > self.requested(now)
    }

    pub(super) fn is_resting(&self, thread: usize) -> bool {
        self.activities[thread] == Activity::Rests
    }

    /// Threads that rest and come before this one.
    pub(super) fn resting_before(&self, thread: usize) -> usize {
        (0..thread).filter(|other| self.is_resting(*other)).count()
    }

    fn awake(&self) -> usize {
        self.activities.iter().filter(|activity| **activity != Activity::Rests).count()
    }

    /// Threads that serve long frames.
    fn away(&self) -> usize {
        let is_away =
            |activity: &&Activity| matches!(activity, Activity::Serves { is_long: true, .. });
        self.activities.iter().filter(is_away).count()
    }

    fn requested(&self, now: Instant) -> usize {
        let active = self.sessions_within(ACTIVE_FOR, now).count();
        (active.clamp(1, self.most_awake) + self.away()).min(self.activities.len())
    }
}

fn is_within(at: Instant, now: Instant, time: Duration) -> bool {
    now.saturating_duration_since(at) < time
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Workers of which all rest but the first, which leads.
    fn at_rest(threads: usize, cores: usize) -> Workers {
        let mut workers = Workers::new(threads, cores);
        assert!(workers.lead(0));
        assert!((1..threads).all(|thread| workers.rest(thread)));
        workers
    }

    /// Has a thread that is away with a long frame, or the one that leads, serve a short one in between.
    fn serve_short(workers: &mut Workers, now: Instant) -> Option<usize> {
        let woken = workers.begin(0, false, now);
        workers.end(0);
        woken
    }

    #[test]
    fn one_thread_is_awake_for_each_active_session() {
        let (mut workers, start) = (at_rest(8, 8), Instant::now());
        workers.note_active(1, start);
        assert_eq!(serve_short(&mut workers, start), None, "one client has one thread");
        workers.note_active(2, start);
        workers.note_active(2, start);
        assert_eq!([(); 2].map(|()| serve_short(&mut workers, start)), [Some(1), None]);
        for session in 3..20 {
            workers.note_active(session, start);
        }
        assert_eq!([(); 2].map(|()| serve_short(&mut workers, start)), [Some(2), Some(3)]);
        assert_eq!(serve_short(&mut workers, start), None, "half of the cores are the clients'");
        assert!(!workers.is_too_many(start));
        assert!(workers.is_too_many(start + 3 * MS), "they were active long ago");
    }

    #[test]
    fn a_long_frame_has_another_thread_listen() {
        let (mut workers, start) = (at_rest(3, 2), Instant::now());
        workers.note_active(1, start);
        assert_eq!(workers.begin(0, true, start), Some(1));
        assert!(!workers.is_led() && workers.lead(1) && !workers.lead(2));
        assert!(!workers.rest(1), "nobody else listens");
        assert!(!workers.is_too_many(start + 10 * MS));
        assert!(workers.may_be_away(), "a third one is left");
        assert_eq!(workers.begin(1, true, start), Some(2));
        assert!(!workers.may_be_away() && workers.lead(2));
        workers.end(1);
        workers.end(0);
        assert!(workers.is_too_many(start + 10 * MS));
        assert!(workers.rest(1) && workers.rest(0) && !workers.rest(2));
        assert!(workers.is_resting(1) && workers.wake(1) && !workers.wake(1));
    }

    #[test]
    fn a_frame_that_takes_longer_than_expected_is_not_waited_for() {
        let (mut workers, start) = (at_rest(3, 2), Instant::now());
        assert!(!workers.relieve(1, start + 100 * MS), "a thread leads");
        assert_eq!(workers.begin(0, false, start), None);
        assert!(!workers.relieve(1, start + 4 * MS), "it may end at any moment");
        assert!(!workers.relieve(2, start + 20 * MS), "one is enough");
        assert!(workers.relieve(1, start + 20 * MS) && !workers.relieve(2, start + 20 * MS));
        assert!(workers.lead(1));
    }

    #[test]
    fn those_count_who_came_within_as_long_as_a_frame_takes() {
        let (mut workers, start) = (at_rest(3, 2), Instant::now());
        workers.note_active(1, start);
        let count = |ms, later| workers.sessions_within(ms * MS, start + later * MS).count();
        assert_eq!([count(1, 1), count(1, 16), count(20, 16), count(5000, 99)], [1, 0, 1, 1]);
    }

    #[test]
    fn sessions_that_ended_are_dropped() {
        let (mut workers, start) = (at_rest(2, 2), Instant::now());
        for session in 0..1000 {
            workers.note_active(session, start + MS * session as u32);
            assert!(workers.seen.len() <= 101);
        }
    }

    /// All that a thread can do next, and all that may be done to it, as `Scheduler` has it: the workers after that.
    fn steps(workers: &Workers, thread: usize, now: Instant) -> Vec<Workers> {
        let mut after = Vec::new();
        let mut step = |change: &dyn Fn(&mut Workers)| {
            let mut changed = workers.clone();
            change(&mut changed);
            after.push(changed);
        };
        let begin = |is_long: bool| {
            move |workers: &mut Workers| {
                if !is_long || workers.may_be_away() {
                    workers.begin(thread, is_long, now);
                }
            }
        };
        match workers.activities[thread] {
            // It leads, serves what waits, goes to rest, or goes on looking.
            Activity::Idle => {
                step(&|workers| _ = workers.lead(thread));
                step(&|workers| _ = workers.rest(thread));
                step(&begin(false));
                step(&begin(true));
            }
            // It serves, naps, rests, or leaves the lead to the first thread and rests.
            Activity::Leads => {
                step(&|workers| workers.end(thread));
                step(&|workers| _ = workers.rest(thread));
                step(&|workers| {
                    workers.wake(0);
                    workers.rest(thread);
                });
                step(&begin(false));
                step(&begin(true));
            }
            Activity::Serves { .. } => step(&|workers| workers.end(thread)),
            // Only others wake it: by themselves threads look up late.
            Activity::Rests => {}
        }
        after
    }

    /// Whether a request that comes now is noticed without the end of a long frame: see the head of this file.
    fn somebody_listens(workers: &Workers) -> bool {
        let is_away = |a: &Activity| matches!(a, Activity::Serves { is_long: true, .. });
        let listens = |a: &Activity| !is_away(a) && *a != Activity::Rests;
        workers.activities.iter().all(is_away) || workers.activities.iter().any(listens)
    }

    #[test]
    fn somebody_listens_in_any_order_of_steps() {
        let now = Instant::now();
        for (threads, active) in [(1, 0), (2, 0), (3, 0), (3, 5), (4, 1), (5, 3)] {
            let mut first = Workers::new(threads, threads.saturating_sub(1).max(1));
            (0..active).for_each(|session| first.note_active(session, now));
            let (mut seen, mut left) = (HashSet::from([first.clone()]), vec![first]);
            while let Some(workers) = left.pop() {
                assert!(somebody_listens(&workers), "{workers:?}");
                let leaders = workers.activities.iter().filter(|a| **a == Activity::Leads).count();
                assert!(leaders <= 1, "{workers:?}");
                assert!(threads == 1 || workers.away() < threads, "one is left for short frames");
                for next in (0..threads).flat_map(|thread| steps(&workers, thread, now)) {
                    if seen.insert(next.clone()) {
                        left.push(next);
                    }
                }
            }
            assert!(seen.len() >= [1, 2, 15, 60, 200][threads - 1], "{} states", seen.len());
        }
    }
}
