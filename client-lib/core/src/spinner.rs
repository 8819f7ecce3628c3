//! Spinning on a core that the awaited process may need.

use std::thread::yield_now;

/// Rounds between two yields of the core, 3 to 5 µs. A yield that no thread takes costs 0.3 µs.
const ROUNDS: u32 = 32;

/// Spins, and yields the core every few µs.
///
/// The scheduler often puts a woken thread on the core of the thread that woke it. Two threads that
/// spin for each other on one core would block each other until the scheduler moves one of them,
/// which takes milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spinner {
    round: u32,
}

impl Spinner {
    /// Spins one round.
    pub fn turn(&mut self) {
        self.round += 1;
        if self.round.is_multiple_of(ROUNDS) {
            yield_now();
        } else {
            std::hint::spin_loop();
        }
    }

    /// Yields the core at once: for a caller that knows that another thread needs it.
    pub fn offer(&mut self) {
        self.round = 0;
        yield_now();
    }
}
