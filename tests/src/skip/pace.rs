//! When frames begin: one after the other, or at the pace of a game.

use std::time::{Duration, Instant};

/// The rest of a wait that is spun: what a sleep may be late by, so that a frame begins when it is due.
const SPIN: Duration = Duration::from_micros(200);

/// When each frame of a run is due.
#[derive(Clone, Copy, Debug)]
pub enum Pace {
    /// A frame begins when the one before is done: a closed loop.
    Closed,
    /// Frames are due at equal intervals, whether the one before is done or not: an open loop. The time of
    /// a late frame counts from when it was due.
    Open {
        /// When the first frame is due.
        start: Instant,
        /// Between two frames.
        period: Duration,
    },
}

impl Pace {
    /// The pace of a run that begins now, by frames a second; `None` is a closed loop.
    pub fn from_now(rate: Option<f64>) -> Self {
        match rate {
            None => Self::Closed,
            Some(rate) => {
                Self::Open { start: Instant::now(), period: Duration::from_secs_f64(1.0 / rate) }
            }
        }
    }

    /// When a frame is due; in a closed loop, now.
    pub fn due(&self, frame: u32) -> Instant {
        match *self {
            Self::Closed => Instant::now(),
            Self::Open { start, period } => start + period * frame,
        }
    }

    /// Waits until a frame is due, and returns that instant. A frame that is late does not wait.
    pub fn wait(&self, frame: u32) -> Instant {
        let due = self.due(frame);
        let left = due.saturating_duration_since(Instant::now());
        std::thread::sleep(left.saturating_sub(SPIN));
        while Instant::now() < due {
            std::hint::spin_loop();
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_at_a_pace_are_due_at_equal_intervals_whatever_they_took() {
        let pace = Pace::from_now(Some(500.0));
        let first = pace.wait(0);
        std::thread::sleep(Duration::from_millis(7));
        // Late by two periods and more: it is due when it was.
        assert_eq!(pace.wait(1) - first, Duration::from_millis(2));
        let last = pace.wait(8);
        assert_eq!(last - first, Duration::from_millis(16));
        assert!(Instant::now() >= last, "no frame begins before it is due");
    }
}
