//! When a tick ends: all writers have committed, or its deadline has passed.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use super::MemberId;

/// The ticks of a scene. A tick is open from its first commit on.
#[derive(Clone, Debug)]
pub struct Ticks {
    deadline: Duration,
    /// Ticks that were closed.
    count: u64,
    committed: HashSet<MemberId>,
    /// Who is waited for, in the order of their lowest indices.
    writers: Vec<MemberId>,
    missing: HashSet<MemberId>,
    closes_at: Option<Instant>,
}

/// A tick that was closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Closed {
    /// Its number, from 1.
    pub number: u64,
    /// Writers that had not committed, in the order in which they were given.
    pub late: Vec<MemberId>,
}

impl Ticks {
    /// Ticks that end so long after their first commit at the latest.
    pub fn new(deadline: Duration) -> Self {
        Self {
            deadline,
            count: 0,
            committed: HashSet::new(),
            writers: Vec::new(),
            missing: HashSet::new(),
            closes_at: None,
        }
    }

    /// How long a tick is open at the most.
    pub const fn deadline(&self) -> Duration {
        self.deadline
    }

    /// When the open tick closes at the latest; `None` where nobody has committed.
    pub const fn closes_at(&self) -> Option<Instant> {
        self.closes_at
    }

    /// The members that are waited for from now on, each once, in the order in which they are reported.
    pub fn wait_for(&mut self, writers: Vec<MemberId>) {
        let missing = writers.iter().filter(|writer| !self.committed.contains(writer));
        self.missing = missing.copied().collect();
        self.writers = writers;
    }

    /// A member commits. Whether it had not yet, in the open tick.
    #[must_use]
    pub fn commit(&mut self, member: MemberId, now: Instant) -> bool {
        let is_first = self.committed.insert(member);
        if is_first {
            self.missing.remove(&member);
            self.closes_at.get_or_insert(now + self.deadline);
        }
        is_first
    }

    /// A member has left, and its commit with it; [`wait_for`](Self::wait_for) is to follow where it was a
    /// writer. A tick that nobody else has committed in is no longer open.
    pub fn discard(&mut self, member: MemberId) {
        self.committed.remove(&member);
        if self.committed.is_empty() {
            self.closes_at = None;
        }
    }

    /// Whether the open tick is to be closed: all writers have committed or its deadline has passed.
    pub fn is_due(&self, now: Instant) -> bool {
        self.closes_at.is_some_and(|closes_at| self.missing.is_empty() || now >= closes_at)
    }

    /// Closes the open tick, if it is [due](Self::is_due).
    pub fn close(&mut self, now: Instant) -> Option<Closed> {
        if !self.is_due(now) {
            return None;
        }
        let is_late = |writer: &&MemberId| self.missing.contains(writer);
        let late = self.writers.iter().filter(is_late).copied().collect();
        self.closes_at = None;
        self.committed.clear();
        self.missing.extend(&self.writers);
        self.count += 1;
        Some(Closed { number: self.count, late })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: MemberId = MemberId(1);
    const B: MemberId = MemberId(2);
    const C: MemberId = MemberId(3);
    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_tick_ends_when_all_writers_have_committed() {
        let (mut ticks, now) = (Ticks::new(10 * MS), Instant::now());
        assert_eq!(ticks.close(now), None, "nobody has committed");
        ticks.wait_for(vec![A, B]);
        assert!(ticks.commit(B, now));
        assert!(!ticks.commit(B, now));
        assert_eq!(ticks.close(now), None);
        // One that only listens is not waited for.
        assert!(ticks.commit(C, now));
        assert_eq!(ticks.close(now), None);
        assert!(ticks.commit(A, now));
        assert_eq!(ticks.close(now), Some(Closed { number: 1, late: vec![] }));
        assert_eq!(ticks.close(now + 99 * MS), None, "the next one is not open");
    }

    #[test]
    fn a_tick_ends_at_its_deadline_and_names_who_is_late() {
        let (mut ticks, now) = (Ticks::new(10 * MS), Instant::now());
        ticks.wait_for(vec![B, A, C]);
        assert!(ticks.commit(C, now));
        assert!(ticks.commit(A, now + 5 * MS));
        assert_eq!(ticks.closes_at(), Some(now + 10 * MS), "counted from the first commit");
        assert_eq!(ticks.close(now + 9 * MS), None);
        let closed = ticks.close(now + 10 * MS);
        assert_eq!(closed, Some(Closed { number: 1, late: vec![B] }));
        assert!(ticks.commit(B, now + 11 * MS), "of the next tick");
        assert_eq!(ticks.closes_at(), Some(now + 21 * MS));
    }

    #[test]
    fn who_is_ended_is_not_waited_for() {
        let (mut ticks, now) = (Ticks::new(10 * MS), Instant::now());
        ticks.wait_for(vec![A]);
        assert!(ticks.commit(A, now));
        ticks.discard(A);
        ticks.wait_for(vec![]);
        assert_eq!((ticks.closes_at(), ticks.close(now)), (None, None));
        ticks.wait_for(vec![B, A]);
        assert!(ticks.commit(A, now));
        assert_eq!(ticks.close(now), None);
        ticks.discard(B);
        ticks.wait_for(vec![A]);
        assert_eq!(ticks.close(now), Some(Closed { number: 1, late: vec![] }));
    }
}
