//! How long to spin for the next request.

use std::time::{Duration, Instant};

/// A client that came back within this time is waited for as long. Spinning for a gap costs as much of a core as the gap is long, and spares what a
/// wake-up takes on both sides, 40 to 100 µs, and the sleep of the engines' threads.
const LONGEST: Duration = Duration::from_millis(1);
/// A gap is waited for until it is so many times as long as the last one.
const ROOM: u32 = 2;

/// Learns from the last gap between an answer and the next request how long the next one may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    least: Duration,
    answered_at: Option<Instant>,
    gap: Duration,
}

impl Patience {
    /// Waits for `least` whatever the gaps are; not at all where that is nothing.
    pub(super) const fn new(least: Duration) -> Self {
        Self { least, answered_at: None, gap: Duration::ZERO }
    }

    /// A request has come.
    pub(super) fn note_request(&mut self, now: Instant) {
        // Several may come between two answers: the first ended the gap.
        if let Some(answered_at) = self.answered_at.take() {
            self.gap = now.saturating_duration_since(answered_at);
        }
    }

    /// How long to spin after an answer.
    pub(super) fn after_answer(&mut self, now: Instant) -> Duration {
        self.answered_at = Some(now);
        let longest = LONGEST.max(self.least);
        if self.least.is_zero() || self.gap > longest {
            return self.least;
        }
        (self.gap * ROOM).clamp(self.least, longest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: Duration = Duration::from_micros(1);

    /// Patience after a gap of so many µs.
    fn after(least: Duration, gap: u32) -> Duration {
        let mut patience = Patience::new(least);
        let start = Instant::now();
        assert_eq!(patience.after_answer(start), least);
        patience.note_request(start + gap * US);
        patience.note_request(start + 2 * gap * US);
        patience.after_answer(start + 3 * gap * US)
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
}
