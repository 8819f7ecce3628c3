//! How long the next frame will take, so that its client can sleep through most of it.

use std::time::Duration;

/// Frames shorter than this are not slept through: a wake-up costs 50 µs and more.
const SHORTEST_NAP: Duration = Duration::from_micros(250);
/// The nap ends this long before the expected end: the delay of a late wake-up on a busy machine.
const WAKE_MARGIN: Duration = Duration::from_micros(120);
/// The nap of a long frame ends this share of the frame before its expected end: frame times vary
/// by as much, and an answer that comes during the nap is taken only when the nap ends.
const WAKE_SHARE: u32 = 16;
/// Scenes whose box counts differ by more than a quarter are not compared.
const SIMILAR: u32 = 4;

/// A frame that was answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answered {
    /// Boxes.
    pub n: u32,
    /// Time from submission to the answer in hand, a late wake-up of this client included.
    pub round_trip: Duration,
    /// Time that the frame took by the daemon's own report.
    pub took: Duration,
    /// Threads that its engine used.
    pub threads: usize,
}

/// The estimate of one session: the shortest recent frame, aged so that it follows the scene.
///
/// The nap goes by the time that the daemon reports: by the round trip, a client that woke up late
/// would sleep longer the next time. Spinning goes by the round trip: where both sides sleep too
/// early, the client has to spin until the daemon has woken up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Estimate {
    n: u32,
    round_trip: Duration,
    took: Duration,
    threads: usize,
}

/// The aged shortest time: a shorter frame replaces it at once, a longer one adds a sixteenth of the
/// difference, so that one slow frame in many hardly changes it.
fn aged(known: Duration, new: Duration) -> Duration {
    if new < known { new } else { known + new.saturating_sub(known) / 16 }
}

/// What is expected of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Expected {
    /// How long to sleep after it was sent; zero for a short one.
    pub nap: Duration,
    /// The time to its answer; zero where nothing is known.
    pub round_trip: Duration,
    /// Threads that the engine uses; zero where nothing is known.
    pub threads: usize,
}

impl Estimate {
    /// What is expected of a request of `n` boxes.
    pub fn expect(&self, n: u32) -> Expected {
        Expected { nap: self.nap(n), round_trip: self.round_trip(n), threads: self.threads(n) }
    }

    /// Updates the estimate by an answered frame.
    pub fn note(&mut self, frame: Answered) {
        let Answered { n, round_trip, took, threads } = frame;
        // At most the round trip: the daemon's figure is input from another process.
        let took = took.min(round_trip);
        *self = if self.covers(n) {
            Self {
                n,
                round_trip: aged(self.round_trip, round_trip),
                took: aged(self.took, took),
                threads,
            }
        } else {
            Self { n, round_trip, took, threads }
        };
    }

    /// How long to sleep after a submission of `n` boxes; zero without an estimate and for short
    /// frames.
    fn nap(&self, n: u32) -> Duration {
        if !self.covers(n) || self.took < SHORTEST_NAP {
            return Duration::ZERO;
        }
        self.took.saturating_sub(WAKE_MARGIN.max(self.took / WAKE_SHARE))
    }

    /// The expected round trip of `n` boxes; zero without an estimate.
    fn round_trip(&self, n: u32) -> Duration {
        if self.covers(n) { self.round_trip } else { Duration::ZERO }
    }

    /// Threads that the engine is expected to use on `n` boxes; zero without an estimate.
    fn threads(&self, n: u32) -> usize {
        if self.covers(n) { self.threads } else { 0 }
    }

    fn covers(&self, n: u32) -> bool {
        !self.round_trip.is_zero() && n.abs_diff(self.n) <= self.n / SIMILAR
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn frame(n: u32, took: Duration) -> Answered {
        Answered { n, round_trip: took, took, threads: 1 }
    }

    #[test]
    fn naps_only_through_long_frames_of_like_size() {
        let mut estimate = Estimate::default();
        assert_eq!(estimate.nap(1000), Duration::ZERO);
        estimate.note(frame(1000, MS));
        assert_eq!(estimate.nap(1000) + WAKE_MARGIN, MS);
        assert_eq!((estimate.nap(1251), estimate.threads(1251)), (Duration::ZERO, 0));
        assert_eq!((estimate.round_trip(1250), estimate.round_trip(1251)), (MS, Duration::ZERO));
        estimate.note(frame(10, MS / 100));
        assert_eq!((estimate.nap(10), estimate.threads(10)), (Duration::ZERO, 1));
    }

    #[test]
    fn follows_faster_frames_at_once_and_slower_ones_slowly() {
        let mut estimate = Estimate::default();
        estimate.note(frame(1000, 4 * MS));
        estimate.note(frame(1000, MS));
        assert_eq!(estimate.nap(1000) + WAKE_MARGIN, MS);
        estimate.note(frame(1000, 17 * MS));
        let left = 2 * MS / WAKE_SHARE;
        assert_eq!(estimate.nap(1000) + left, 2 * MS, "more than the margin");
    }

    #[test]
    fn a_late_wake_up_stretches_the_spinning_and_not_the_nap() {
        let mut estimate = Estimate::default();
        estimate.note(Answered { round_trip: 5 * MS, ..frame(1000, MS) });
        assert_eq!(estimate.nap(1000) + WAKE_MARGIN, MS);
        assert_eq!(estimate.round_trip(1000), 5 * MS);
        // Nor does a daemon that reports too long a time.
        estimate.note(Answered { took: Duration::MAX, ..frame(10, MS) });
        assert_eq!(estimate.nap(10) + WAKE_MARGIN, MS);
    }
}
