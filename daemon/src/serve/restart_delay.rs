//! How long to wait before a worker that died is started again.
//!
//! A worker that was killed is started again at once, so that its clients miss a few frames. A request
//! that kills every worker must not make a busy loop: restarts beyond a burst are spread over time.

use std::time::{Duration, Instant};

/// Restarts that may follow each other without a pause: more than an operator, a test or a client that
/// is sent to another machine brings about in a row.
const BURST: u32 = 100;
/// Beyond the burst there is one restart in this time. Workers that are killed less often than that are
/// always replaced at once; one that dies as soon as it starts (30 to 60 ms of a core) costs a fifth of a
/// core at the most.
const INTERVAL: Duration = Duration::from_millis(250);

/// Spreads restarts over time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RestartDelay {
    /// The time that the restarts so far have used up, at one [`INTERVAL`] each.
    used_until: Option<Instant>,
}

impl RestartDelay {
    /// The pause before the restart of a worker that was seen dead at `now`.
    pub(super) fn of_death(&mut self, now: Instant) -> Duration {
        let used_until = self.used_until.map_or(now, |until| until.max(now)) + INTERVAL;
        self.used_until = Some(used_until);
        (used_until - now).saturating_sub(BURST * INTERVAL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pauses of workers that die `apart` after their start.
    fn pauses(apart: Duration, count: usize) -> Vec<Duration> {
        let (mut delay, mut now) = (RestartDelay::default(), Instant::now());
        let mut pause = || {
            now += apart;
            let pause = delay.of_death(now);
            now += pause;
            pause
        };
        std::iter::repeat_with(&mut pause).take(count).collect()
    }

    #[test]
    fn the_first_restarts_come_at_once() {
        let pauses = pauses(Duration::from_millis(50), BURST as usize);
        assert!(pauses.iter().all(Duration::is_zero), "{pauses:?}");
    }

    #[test]
    fn kills_with_a_pause_between_them_are_never_waited_for() {
        assert!(pauses(INTERVAL, 1000).iter().all(Duration::is_zero));
    }

    #[test]
    fn workers_that_die_at_once_make_no_busy_loop() {
        let pauses = pauses(Duration::ZERO, 1000);
        let waited: Duration = pauses.iter().sum();
        assert_eq!(waited, INTERVAL * (1000 - BURST));
        assert!(pauses.iter().all(|pause| *pause <= INTERVAL));
    }

    #[test]
    fn a_worker_that_lives_long_makes_the_next_restarts_free_again() {
        let (mut delay, start) = (RestartDelay::default(), Instant::now());
        let late = (0..2 * BURST).map(|_| delay.of_death(start)).last();
        assert_eq!(late, Some(INTERVAL * BURST));
        let later = start + INTERVAL * 4 * BURST;
        assert!((0..BURST).all(|_| delay.of_death(later).is_zero()));
    }
}
