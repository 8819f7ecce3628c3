//! What two sides say to each other by words of their boards, so that neither misses the other.
//!
//! Who sends writes a message, then its number, then looks whether the other side sleeps; who falls asleep says so, then
//! looks for messages. A fence stands between the two steps of each, so that one of the two sees the other: a message is
//! seen, or its sender wakes the sleeper. A place is written to again when the other side has let go of what was in it. A
//! test runs this file under a model of memory (`tests/tests/cpu/memory_model`), so it names `super::atomic`.

use super::atomic::{AtomicU64, Ordering, fence};

/// Says that the message of this number is there. After it [`sleeps`] is to be asked.
pub fn announce(sent: &AtomicU64, number: u64) {
    sent.store(number, Ordering::Release);
    fence(Ordering::SeqCst);
}

/// The number that was announced last, or let go of: what its writer did before is seen.
pub fn last(number: &AtomicU64) -> u64 {
    number.load(Ordering::Acquire)
}

/// Says that the message of this number is not read any more.
pub fn release(released: &AtomicU64, number: u64) {
    released.store(number, Ordering::Release);
}

/// Says that this side sleeps: what is not seen by a look after this wakes it.
pub fn fall_asleep(sleeps: &AtomicU64) {
    sleeps.store(1, Ordering::Relaxed);
    fence(Ordering::SeqCst);
}

/// Says that this side looks by itself.
pub fn wake_up(sleeps: &AtomicU64) {
    sleeps.store(0, Ordering::Relaxed);
}

/// Whether the other side is to be woken.
pub fn sleeps(sleeps: &AtomicU64) -> bool {
    sleeps.load(Ordering::Relaxed) != 0
}
