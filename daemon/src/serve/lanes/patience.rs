//! When the worker spins for the next request, and when it sleeps.

use std::time::{Duration, Instant};

use pairmask_core::rhythm::{Rhythm, Wake};

/// A client that came back within this time is waited for as long. Spinning for a gap costs as much of a core as the gap is long, and spares what a
/// wake-up takes on both sides, 40 to 100 µs, and the sleep of the engines' threads.
const LONGEST: Duration = Duration::from_millis(1);
/// A gap is waited for until it is so many times as long as the last one.
const ROOM: u32 = 2;
/// The longest sleep: how soon a stop signal, a request without a wake-up and the end of a client
/// are noticed at the latest. Two wake-ups a second cost nothing that can be measured.
pub(super) const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// What to do without a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rest {
    /// Look for requests all the time: a client that was answered may come back at once.
    Spin,
    /// The same, because a client's next frame is due before that time. Engine threads are wanted awake
    /// where it may come at once.
    Expect { until: Instant, is_near: bool },
    /// Sleep until woken, until then at most.
    Sleep { until: Instant },
}

/// Learns from the last gap between an answer and the next request how long the next one may be, and
/// from each client's requests when its next one is due. `C` tells clients apart.
#[derive(Clone, Debug)]
pub(super) struct Patience<C> {
    least: Duration,
    answered_at: Option<Instant>,
    gap: Duration,
    /// Until when it spins after the last answer.
    spin_until: Option<Instant>,
    rhythm: Rhythm<C>,
    /// The next time to be awake, as far as it was computed.
    wake: Option<Wake>,
}

impl<C: PartialEq> Patience<C> {
    /// Waits for `least` whatever the gaps are; where that is nothing, never spins.
    pub(super) fn new(least: Duration) -> Self {
        Self {
            least,
            answered_at: None,
            gap: Duration::ZERO,
            spin_until: None,
            rhythm: Rhythm::default(),
            wake: None,
        }
    }

    /// A request of a client has come.
    pub(super) fn note_request(&mut self, client: C, now: Instant) {
        // Several may come between two answers: the first ended the gap.
        if let Some(answered_at) = self.answered_at.take() {
            self.gap = now.saturating_duration_since(answered_at);
        }
        self.rhythm.note_request(client, now);
        self.wake = None;
    }

    /// A request was answered. Returns until when to spin for the next one.
    pub(super) fn note_answer(&mut self, now: Instant) -> Instant {
        self.answered_at = Some(now);
        let longest = LONGEST.max(self.least);
        let patience = if self.least.is_zero() || self.gap > longest {
            self.least
        } else {
            (self.gap * ROOM).clamp(self.least, longest)
        };
        let until = now + patience;
        self.spin_until = Some(until);
        until
    }

    /// What to do now, without a request.
    pub(super) fn rest(&mut self, now: Instant) -> Rest {
        if self.spin_until.is_some_and(|until| now < until) {
            return Rest::Spin;
        }
        let longest = now + LONGEST_SLEEP;
        if self.least.is_zero() {
            return Rest::Sleep { until: longest };
        }
        if self.wake.is_none_or(|wake| wake.spin_until <= now) {
            self.wake = self.rhythm.next_wake(now);
        }
        match self.wake {
            Some(wake) if wake.is_awake(now) => {
                Rest::Expect { until: wake.spin_until, is_near: wake.engines_at() <= now }
            }
            Some(wake) => Rest::Sleep { until: wake.sleep_until.min(longest) },
            None => Rest::Sleep { until: longest },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: Duration = Duration::from_micros(1);
    const MS: Duration = Duration::from_millis(1);

    /// Patience after a gap of so many µs.
    fn after(least: Duration, gap: u32) -> Duration {
        let mut patience = Patience::new(least);
        let start = Instant::now();
        assert_eq!(patience.note_answer(start), start + least);
        patience.note_request(1, start + gap * US);
        patience.note_request(1, start + 2 * gap * US);
        let answered = start + 3 * gap * US;
        patience.note_answer(answered) - answered
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

    /// Patience after 20 frames, 16 ms each, and when the last of them was answered.
    fn steady(least: Duration) -> (Patience<u32>, Instant) {
        let mut patience = Patience::new(least);
        let mut now = Instant::now();
        for _ in 0..20 {
            now += 16 * MS;
            patience.note_request(1, now);
            patience.note_answer(now + 40 * US);
        }
        (patience, now)
    }

    #[test]
    fn is_awake_for_a_steady_client_and_asleep_otherwise() {
        let (mut patience, last) = steady(50 * US);
        assert_eq!(patience.rest(last + 60 * US), Rest::Spin);
        let Rest::Sleep { until } = patience.rest(last + 90 * US) else { panic!("it sleeps") };
        assert!(last + 15 * MS < until && until < last + 16 * MS);
        let Rest::Expect { until, is_near: false } = patience.rest(until) else {
            panic!("it is awake")
        };
        let near = Rest::Expect { until, is_near: true };
        assert_eq!(patience.rest(last + 16 * MS), near, "the engines' threads too");
        assert!(last + 16 * MS < until && until < last + 17 * MS);
        // The frame does not come, nor the next ones.
        let mut now = until;
        let mut spins = 0;
        while now < last + 10_000 * MS {
            now = match patience.rest(now) {
                Rest::Expect { until, .. } => {
                    spins += 1;
                    until
                }
                Rest::Sleep { until } => until,
                Rest::Spin => panic!("nobody was answered"),
            };
        }
        assert_eq!(spins, 2, "two more beats are awaited");
    }

    #[test]
    fn never_spins_where_that_is_the_setting() {
        let (mut patience, last) = steady(Duration::ZERO);
        for ms in [0, 15, 16, 17] {
            let now = last + ms * MS + 50 * US;
            assert_eq!(patience.rest(now), Rest::Sleep { until: now + LONGEST_SLEEP });
        }
    }
}
