//! How many lanes are awake.

use std::time::{Duration, Instant};

/// A session counts as active so long after its last request or answer. A closed loop comes back within
/// some tens of µs; a game at 240 frames a second is worth a wake-up, not a core.
const ACTIVE_FOR: Duration = Duration::from_millis(2);

/// Which lanes are awake, and how many should be: one for each session that asked for small frames a
/// moment ago, and one for each lane that is away with a long frame.
///
/// Instants come from outside, and who is told to wake or rest is told by the caller.
#[derive(Debug)]
pub(super) struct Crew {
    /// Sessions and when they were active last.
    seen: Vec<(u128, Instant)>,
    is_resting: Vec<bool>,
    /// Lanes that serve long frames.
    away: usize,
    /// The most lanes that are awake for active sessions.
    most_awake: usize,
}

impl Crew {
    /// So many lanes, all awake, for a machine of so many cores: half of them are the clients'.
    pub(super) fn new(lanes: usize, cores: usize) -> Self {
        Self {
            seen: Vec::new(),
            is_resting: vec![false; lanes],
            away: 0,
            most_awake: (cores / 2).clamp(1, lanes.max(1)),
        }
    }

    /// A session has sent a request for a small frame, or was answered one.
    pub(super) fn note_active(&mut self, session: u128, now: Instant) {
        if let Some((_, at)) = self.seen.iter_mut().find(|(seen, _)| *seen == session) {
            *at = now;
        } else {
            self.seen.retain(|(_, at)| is_recent(*at, now));
            self.seen.push((session, now));
        }
    }

    /// Sessions that were active a moment ago.
    pub(super) fn sessions(&self, now: Instant) -> impl Iterator<Item = u128> {
        self.seen.iter().filter(move |(_, at)| is_recent(*at, now)).map(|(session, _)| *session)
    }

    /// Their number.
    pub(super) fn active(&self, now: Instant) -> usize {
        self.sessions(now).count()
    }

    /// A lane begins to serve a long frame.
    pub(super) fn note_away(&mut self) {
        self.away += 1;
    }

    /// A lane has served a long frame.
    pub(super) fn note_back(&mut self) {
        self.away = self.away.saturating_sub(1);
    }

    /// A lane to wake, which counts as awake from now on; `None` where enough are.
    pub(super) fn wake(&mut self, now: Instant) -> Option<usize> {
        if self.awake() >= self.wanted(now) {
            return None;
        }
        let lane = self.is_resting.iter().position(|is_resting| *is_resting)?;
        self.is_resting[lane] = false;
        Some(lane)
    }

    /// Wakes a lane of which it is known that it is needed. Whether it rested.
    pub(super) fn wake_lane(&mut self, lane: usize) -> bool {
        std::mem::take(&mut self.is_resting[lane])
    }

    /// Whether more lanes are awake than are wanted.
    pub(super) fn is_too_large(&self, now: Instant) -> bool {
        self.awake() > self.wanted(now)
    }

    /// A lane goes to rest.
    pub(super) fn rest(&mut self, lane: usize) {
        self.is_resting[lane] = true;
    }

    /// Whether a lane rests.
    pub(super) fn is_resting(&self, lane: usize) -> bool {
        self.is_resting[lane]
    }

    /// Lanes that do not rest.
    pub(super) fn awake(&self) -> usize {
        self.is_resting.iter().filter(|is_resting| !**is_resting).count()
    }

    fn wanted(&self, now: Instant) -> usize {
        (self.active(now).clamp(1, self.most_awake) + self.away).min(self.is_resting.len())
    }
}

fn is_recent(at: Instant, now: Instant) -> bool {
    now.saturating_duration_since(at) < ACTIVE_FOR
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// A crew of which all rest but lane 0.
    fn at_rest(lanes: usize, cores: usize) -> Crew {
        let mut crew = Crew::new(lanes, cores);
        (1..lanes).for_each(|lane| crew.rest(lane));
        crew
    }

    #[test]
    fn one_lane_is_awake_for_each_active_session() {
        let (mut crew, start) = (at_rest(8, 8), Instant::now());
        crew.note_active(1, start);
        assert_eq!(crew.wake(start), None, "one client has one lane");
        crew.note_active(2, start);
        crew.note_active(2, start);
        assert_eq!((crew.wake(start), crew.wake(start)), (Some(1), None));
        for session in 3..20 {
            crew.note_active(session, start);
        }
        assert_eq!((crew.wake(start), crew.wake(start)), (Some(2), Some(3)));
        assert_eq!(crew.wake(start), None, "half of the cores are the clients'");
        assert!(!crew.is_too_large(start));
        assert!(crew.is_too_large(start + 3 * MS), "they were active long ago");
    }

    #[test]
    fn a_long_frame_has_another_lane_listen() {
        let (mut crew, start) = (at_rest(2, 2), Instant::now());
        crew.note_active(1, start);
        crew.note_away();
        assert_eq!((crew.wake(start), crew.wake(start)), (Some(1), None));
        assert!(!crew.is_too_large(start + 10 * MS));
        crew.note_back();
        assert!(crew.is_too_large(start + 10 * MS));
        crew.rest(1);
        assert!(crew.is_resting(1) && !crew.is_too_large(start + 10 * MS));
        assert!(crew.wake_lane(1) && !crew.wake_lane(1));
    }

    #[test]
    fn sessions_that_are_gone_are_forgotten() {
        let (mut crew, start) = (at_rest(2, 2), Instant::now());
        for session in 0..1000 {
            crew.note_active(session, start + MS * session as u32);
            assert!(crew.seen.len() <= 3);
        }
    }
}
