//! How long the next frame will take, so that its client can sleep through most of it.

use std::time::Duration;

/// Frames shorter than this are not slept through: a wake-up costs 50 µs and more.
const SHORTEST_NAP: Duration = Duration::from_micros(250);
/// The nap ends this much before the expected end, the time of a late wake-up on a busy machine.
const WAKE_MARGIN: Duration = Duration::from_micros(120);
/// Or, of long frames, this share of the round trip before it: they vary by as much, and an answer
/// that comes during the nap waits for its end.
const WAKE_SHARE: u32 = 16;
/// Scenes that differ by more than a quarter in boxes say nothing of each other.
const SIMILAR: u32 = 4;

/// Round trips of one session: the shortest of late, aged so that it follows the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Estimate {
    n: u32,
    round_trip: Duration,
}

impl Estimate {
    /// Takes note of a round trip.
    pub(super) fn note(&mut self, n: u32, round_trip: Duration) {
        if !self.covers(n) || round_trip < self.round_trip {
            *self = Self { n, round_trip };
        } else {
            // A sixteenth of the way: one slow frame in many does not stretch the nap.
            self.round_trip += round_trip.saturating_sub(self.round_trip) / 16;
            self.n = n;
        }
    }

    /// How long to sleep after a submission of `n` boxes; zero where nothing is known or the
    /// frame is short.
    pub(super) fn nap(&self, n: u32) -> Duration {
        if !self.covers(n) || self.round_trip < SHORTEST_NAP {
            return Duration::ZERO;
        }
        self.round_trip.saturating_sub(WAKE_MARGIN.max(self.round_trip / WAKE_SHARE))
    }

    /// How long a frame of `n` boxes is expected to take; zero where nothing is known.
    pub(super) fn round_trip(&self, n: u32) -> Duration {
        if self.covers(n) { self.round_trip } else { Duration::ZERO }
    }

    fn covers(&self, n: u32) -> bool {
        !self.round_trip.is_zero() && n.abs_diff(self.n) <= self.n / SIMILAR
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn naps_only_through_long_frames_of_like_size() {
        let mut estimate = Estimate::default();
        assert_eq!(estimate.nap(1000), Duration::ZERO);
        estimate.note(1000, MS);
        assert_eq!(estimate.nap(1000) + WAKE_MARGIN, MS);
        assert_eq!(estimate.nap(1251), Duration::ZERO);
        assert_eq!((estimate.round_trip(1250), estimate.round_trip(1251)), (MS, Duration::ZERO));
        estimate.note(10, MS / 100);
        assert_eq!(estimate.nap(10), Duration::ZERO);
    }

    #[test]
    fn follows_faster_frames_at_once_and_slower_ones_slowly() {
        let mut estimate = Estimate::default();
        estimate.note(1000, 4 * MS);
        estimate.note(1000, MS);
        assert_eq!(estimate.nap(1000) + WAKE_MARGIN, MS);
        estimate.note(1000, 17 * MS);
        assert_eq!(estimate.nap(1000), 2 * MS - 2 * MS / WAKE_SHARE, "more than the margin");
    }
}
