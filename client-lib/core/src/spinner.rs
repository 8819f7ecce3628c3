//! Spinning for another process that may want the same core.

use std::thread::yield_now;

/// Rounds of spinning between two offers of the core, 3 to 5 µs: an offer that nobody takes costs
/// 0.3 µs.
const ROUNDS: u32 = 32;

/// Spins, and now and then offers the core to whoever wants it.
///
/// Whoever is woken is often put on the core of the one who woke it. Two that spin for each other
/// there would hold each other up until the scheduler moves one of them, which takes milliseconds.
///
/// ```
/// use pairmask::transport::Spinner;
/// let mut spinner = Spinner::default();
/// for _ in 0..100 {
///     // Look whether the other side has answered, then
///     spinner.turn();
/// }
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Spinner {
    round: u32,
}

impl Spinner {
    /// One round.
    pub fn turn(&mut self) {
        self.round += 1;
        if self.round.is_multiple_of(ROUNDS) {
            yield_now();
        } else {
            std::hint::spin_loop();
        }
    }

    /// One round that offers the core, for those who know that it is wanted.
    pub fn offer(&mut self) {
        self.round = 0;
        yield_now();
    }
}
