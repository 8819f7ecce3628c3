//! The pace of one client.

use std::time::{Duration, Instant};

/// Requests this close to the first of a beat belong to it: a client that sends two scenes a frame has
/// one pace. Clients with more than 2,000 frames a second have none, and need none: a thread that serves
/// them has no time to sleep.
const ONE_BEAT: Duration = Duration::from_micros(500);
/// A pause that ends a pace: no game has frames this long, and what was learned before is old.
const PAUSE: Duration = Duration::from_secs(1);
/// Periods that are remembered: a quarter of a second at 60 Hz, after which a new pace has replaced
/// the old one.
const REMEMBERED: usize = 16;
/// Periods before a pace is known.
const ENOUGH: usize = 6;
/// One in so many of the shortest and of the longest periods is left out as an accident.
const ACCIDENTS: usize = 8;
/// Beats that are expected after one that did not come. Then the client counts as idle: nobody is
/// awake for it.
const MISSED: u32 = 2;

/// When frames of a client come: learned from when the last ones came.
#[derive(Clone, Debug)]
pub(super) struct Predictor {
    /// When the last beat began.
    last: Instant,
    /// The last periods, in a ring.
    periods: [Duration; REMEMBERED],
    /// Periods so far.
    count: usize,
    beat: Option<Beat>,
}

/// A known pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Beat {
    /// Median time from one beat to the next.
    pub(super) period: Duration,
    /// How much earlier than after a period the next beat may come, accidents apart.
    pub(super) early: Duration,
    /// How much later.
    pub(super) late: Duration,
}

impl Predictor {
    /// A client whose first request came at `now`.
    pub(super) const fn new(now: Instant) -> Self {
        Self { last: now, periods: [Duration::ZERO; REMEMBERED], count: 0, beat: None }
    }

    /// A request came. Instants that go backwards count as no time.
    pub(super) fn note(&mut self, now: Instant) {
        let period = now.saturating_duration_since(self.last);
        if period < ONE_BEAT {
            return;
        }
        self.last = now;
        if period > PAUSE {
            *self = Self::new(now);
            return;
        }
        self.periods[self.count % REMEMBERED] = period;
        self.count += 1;
        self.beat = self.learn();
    }

    fn learn(&self) -> Option<Beat> {
        let known = self.count.min(REMEMBERED);
        if known < ENOUGH {
            return None;
        }
        let mut sorted = self.periods;
        let sorted = &mut sorted[..known];
        sorted.sort_unstable();
        let period = sorted[known / 2];
        let accidents = known / ACCIDENTS;
        Some(Beat {
            period,
            early: period.saturating_sub(sorted[accidents]),
            late: sorted[known - 1 - accidents].saturating_sub(period),
        })
    }

    /// When the last beat began.
    pub(super) const fn last(&self) -> Instant {
        self.last
    }

    /// The pace, as far as it is known.
    pub(super) const fn beat(&self) -> Option<Beat> {
        self.beat
    }

    /// When the next beat is expected by one who is awake until `late` after it: after `now`, or not
    /// longer before it than that. `None` where the pace is not known, or has ended.
    pub(super) fn next(&self, now: Instant, late: Duration) -> Option<Instant> {
        let period = self.beat?.period;
        (1..=1 + MISSED).map(|beat| self.last + period * beat).find(|at| *at + late > now)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn predictor(start: Instant, periods: impl IntoIterator<Item = Duration>) -> Predictor {
        let mut predictor = Predictor::new(start);
        let mut now = start;
        for period in periods {
            now += period;
            predictor.note(now);
        }
        predictor
    }

    #[test]
    fn a_pace_is_known_after_a_few_beats() {
        let start = Instant::now();
        let few = predictor(start, [16 * MS; ENOUGH - 1]);
        assert_eq!((few.beat(), few.next(start, MS)), (None, None));
        let known = predictor(start, [16 * MS; ENOUGH]);
        let beat = Beat { period: 16 * MS, early: Duration::ZERO, late: Duration::ZERO };
        assert_eq!(known.beat(), Some(beat));
        assert_eq!(known.next(known.last(), MS), Some(known.last() + 16 * MS));
    }

    #[test]
    fn accidents_change_nothing_and_spread_does() {
        let start = Instant::now();
        let stalls = (0..REMEMBERED).map(|i| if i % 9 == 4 { 40 * MS } else { 16 * MS });
        let beat = predictor(start, stalls).beat().unwrap();
        assert_eq!((beat.period, beat.early, beat.late), (16 * MS, Duration::ZERO, Duration::ZERO));
        let swinging = (0..REMEMBERED).map(|i| if i % 2 == 0 { 15 * MS } else { 17 * MS });
        let beat = predictor(start, swinging).beat().unwrap();
        assert_eq!(beat.early + beat.late, 2 * MS);
    }

    #[test]
    fn a_new_pace_replaces_the_old_one_and_a_pause_ends_it() {
        let start = Instant::now();
        let mut changed = predictor(start, [16 * MS; 40].into_iter().chain([4 * MS; REMEMBERED]));
        assert_eq!(changed.beat().unwrap().period, 4 * MS);
        changed.note(changed.last() + PAUSE + MS);
        assert_eq!(changed.beat(), None);
    }

    #[test]
    fn several_requests_of_a_frame_are_one_beat() {
        let start = Instant::now();
        let mut predictor = Predictor::new(start);
        for frame in 1..=REMEMBERED as u32 {
            for late in [0, 100, 400] {
                predictor.note(start + frame * 16 * MS + Duration::from_micros(late));
            }
        }
        assert_eq!(predictor.beat().unwrap().period, 16 * MS);
        let closed = (0..1000).map(|_| Duration::from_micros(40));
        let beat = self::predictor(start, closed).beat().unwrap();
        assert!(beat.period < MS, "a closed loop beats as often as beats are distinguished");
    }

    #[test]
    fn time_that_goes_backwards_is_no_beat() {
        let start = Instant::now() + 100 * MS;
        let mut known = predictor(start, [10 * MS; REMEMBERED]);
        let before = known.clone();
        known.note(start);
        assert_eq!((known.last(), known.beat()), (before.last(), before.beat()));
    }
}
