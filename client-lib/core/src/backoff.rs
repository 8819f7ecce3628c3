//! Backoff: how long something that did not work is not tried again.

/// Twice as long after each time in vain, up to a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Backoff {
    wait: u32,
    left: u32,
}

impl Backoff {
    /// Turns to wait after the first time: then a sixteenth of what a try costs is lost, and in the end less than a
    /// hundredth. What works again is noticed after as many turns.
    pub const LEAST: u32 = 16;
    const MOST: u32 = 128;

    /// Nothing has failed.
    pub const NONE: Self = Self { wait: 0, left: 0 };

    /// Notes that it did not work.
    pub fn failed(&mut self) {
        self.wait = (2 * self.wait).clamp(Self::LEAST, Self::MOST);
        self.left = self.wait;
    }

    /// Whether it is not to be tried yet.
    pub const fn will_wait(self) -> bool {
        self.left > 0
    }

    /// The same; counts a turn.
    pub fn is_waiting(&mut self) -> bool {
        let is_waiting = self.left > 0;
        self.left = self.left.saturating_sub(1);
        is_waiting
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_time_in_vain_waits_twice_as_long() {
        let mut backoff = Backoff::NONE;
        assert!(!backoff.is_waiting());
        for turns in [16, 32, 64, 128, 128] {
            backoff.failed();
            assert_eq!((0..turns).filter(|_| backoff.is_waiting()).count(), turns);
            assert!(!backoff.is_waiting());
        }
    }
}
