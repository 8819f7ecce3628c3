//! The phases of a team, and the helpers inside of one: how a phase's borrows are kept from threads that outlive it.
//!
//! A helper enters before it looks whether the phase is still open, and the caller closes the phase before it looks
//! whether somebody is inside. A fence stands between the two steps of each, so that one of the two sees the other; and
//! the caller waits for those inside. A test runs this file under a model of memory (`tests/tests/cpu/memory_model`),
//! so it names `super::atomic`.

use super::atomic::{AtomicU32, AtomicUsize, Ordering, fence};

#[derive(Default)]
pub struct Phases {
    /// Number of the phase, odd while it is open.
    number: AtomicU32,
    /// Helpers that are in the open phase, or about to see that it is closed.
    inside: AtomicUsize,
}

impl Phases {
    /// Opens a phase. Those who enter it see what was written before.
    pub fn open(&self) {
        self.number.fetch_add(1, Ordering::Release);
    }

    /// Closes the open phase, and returns when nobody is inside: what they did is seen then.
    pub fn close(&self, mut wait: impl FnMut()) {
        self.number.fetch_add(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        while self.inside.load(Ordering::Acquire) > 0 {
            wait();
        }
    }

    /// The number of the phase that is open, if one is.
    pub fn opened(&self) -> Option<u32> {
        let number = self.number.load(Ordering::Relaxed);
        (number % 2 == 1).then_some(number)
    }

    /// Enters a phase, unless it is closed. It is not over before this is dropped.
    pub fn enter(&self, phase: u32) -> Option<Inside<'_>> {
        self.inside.fetch_add(1, Ordering::Relaxed);
        let inside = Inside(self);
        fence(Ordering::SeqCst);
        (self.number.load(Ordering::Acquire) == phase).then_some(inside)
    }
}

/// A helper in a phase, or one that leaves it at once.
pub struct Inside<'a>(&'a Phases);

impl Drop for Inside<'_> {
    fn drop(&mut self) {
        self.0.inside.fetch_sub(1, Ordering::Release);
    }
}
