//! When the frames of a paced client are due: a pure function of the start and the rate.

use std::time::{Duration, Instant};

use super::asked::Hertz;

const NS_PER_SECOND: u128 = 1_000_000_000;

/// The due times of one client's frames, an open loop: a frame that takes long moves no later one.
///
/// A frame whose predecessor was not done by its due time begins late, and its latency still counts
/// from when it was due. Counted from its own beginning, one stall of many periods would appear as a
/// single slow frame (coordinated omission).
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    start: Instant,
    rate: Hertz,
    /// Frames that were handed out.
    frames: u64,
}

/// A frame's turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Due {
    /// When the frame should begin.
    pub at: Instant,
    /// Whether that time had passed when the client asked for the frame.
    pub is_late: bool,
}

impl Schedule {
    /// A schedule whose first frame is due at `start`.
    pub const fn new(start: Instant, rate: Hertz) -> Self {
        Self { start, rate, frames: 0 }
    }

    /// The next frame, asked for at `now`. Frames are never left out.
    pub fn next(&mut self, now: Instant) -> Due {
        let at = self.start + self.offset(self.frames);
        self.frames += 1;
        Due { at, is_late: now > at }
    }

    /// Computed from the first frame on, so that the rounding of a period does not add up.
    fn offset(&self, frame: u64) -> Duration {
        let ns = u128::from(frame) * NS_PER_SECOND / u128::from(self.rate.get());
        Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn hertz(rate: u32) -> Hertz {
        rate.to_string().parse().unwrap()
    }

    /// Runs `frames` frames against a clock that only frames and waits move: `took(i)` is the time of
    /// frame i. Returns each frame's latency from its due time, and whether it was late.
    fn run(rate: u32, frames: u32, took: impl Fn(u32) -> Duration) -> Vec<(Duration, bool)> {
        let mut now = Instant::now();
        let mut schedule = Schedule::new(now, hertz(rate));
        (0..frames)
            .map(|i| {
                let due = schedule.next(now);
                now = now.max(due.at) + took(i);
                (now - due.at, due.is_late)
            })
            .collect()
    }

    const SHORT: Duration = Duration::from_micros(10);

    #[test]
    fn a_stall_of_k_periods_makes_k_frames_late() {
        let period = Duration::from_millis(1);
        for k in [0, 1, 2, 7, 30] {
            let stall = period * k + period / 2;
            let found = run(1000, 60, |i| if i == 10 { stall } else { SHORT });
            let late: Vec<usize> = (0..60).filter(|i| found[*i].1).collect();
            assert_eq!(late, (11..11 + k as usize).collect::<Vec<_>>(), "a stall of {k} periods");
            // Each late frame has waited for what was left of the stall, one period less than the
            // one before it.
            for (i, frame) in late.iter().enumerate() {
                let i = i as u32 + 1;
                assert_eq!(found[*frame].0 + period * i, stall + SHORT * i);
            }
            let on_time = found.iter().enumerate().filter(|(i, _)| *i != 10 && !late.contains(i));
            assert!(on_time.into_iter().all(|(_, (latency, _))| *latency == SHORT));
        }
    }

    #[test]
    fn a_client_that_is_always_too_slow_falls_behind_without_end() {
        let found = run(1000, 100, |_| Duration::from_micros(1500));
        assert!(found.is_sorted_by(|a, b| a.0 < b.0));
        assert_eq!(found[99].0, Duration::from_millis(51));
    }

    #[test]
    fn periods_do_not_drift() {
        let start = Instant::now();
        let mut schedule = Schedule::new(start, hertz(60));
        let due = (0..=216_000).map(|_| schedule.next(start).at).last();
        assert_eq!(due, Some(start + Duration::from_secs(3600)));
        assert!(!Schedule::new(start, hertz(7)).next(start).is_late, "due now is in time");
    }
}
