//! How long the next frame will take, so that its client can sleep through most of it.

use std::time::Duration;

/// Frames shorter than this are not slept through: a wake-up costs 50 µs and more.
const SHORTEST_NAP: Duration = Duration::from_micros(250);
/// The nap ends this much before the expected end, the time of a late wake-up on a busy machine.
const WAKE_MARGIN: Duration = Duration::from_micros(120);
/// Or, of long frames, this share of them before it: they vary by as much, and an answer
/// that comes during the nap waits for its end.
const WAKE_SHARE: u32 = 16;
/// Scenes that differ by more than a quarter in boxes say nothing of each other.
const SIMILAR: u32 = 4;

/// Frames of one session, each as long as the daemon took for it: the shortest of late, aged so that
/// it follows the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Estimate {
    n: u32,
    took: Duration,
}

impl Estimate {
    /// Takes note of a frame.
    pub(super) fn note(&mut self, n: u32, took: Duration) {
        if !self.covers(n) || took < self.took {
            *self = Self { n, took };
        } else {
            // A sixteenth of the way: one slow frame in many does not stretch the nap.
            self.took += took.saturating_sub(self.took) / 16;
            self.n = n;
        }
    }

    /// How long to sleep after a submission of `n` boxes; zero where nothing is known or the
    /// frame is short.
    pub(super) fn nap(&self, n: u32) -> Duration {
        if !self.covers(n) || self.took < SHORTEST_NAP {
            return Duration::ZERO;
        }
        self.took.saturating_sub(WAKE_MARGIN.max(self.took / WAKE_SHARE))
    }

    /// How long a frame of `n` boxes is expected to take; zero where nothing is known.
    pub(super) fn expected(&self, n: u32) -> Duration {
        if self.covers(n) { self.took } else { Duration::ZERO }
    }

    fn covers(&self, n: u32) -> bool {
        !self.took.is_zero() && n.abs_diff(self.n) <= self.n / SIMILAR
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
        assert_eq!((estimate.expected(1250), estimate.expected(1251)), (MS, Duration::ZERO));
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
        let left = 2 * MS / WAKE_SHARE;
        assert_eq!(estimate.nap(1000) + left, 2 * MS, "more than the margin");
    }
}
