//! Who is next. The system's lock is unfair to threads that spin, and puts the others to sleep at once.
//!
//! A test runs this file under a model of memory (`tests/tests/cpu/memory_model`), so it names `super::atomic`.

use super::atomic::{AtomicU64, Ordering};

#[derive(Debug, Default)]
pub struct Turns {
    asked: AtomicU64,
    /// Turns that have ended: the number of the one that is on.
    ended: AtomicU64,
}

impl Turns {
    /// Takes the next turn, and calls `wait` until it has come.
    pub fn take(&self, mut wait: impl FnMut()) -> Turn<'_> {
        // Relaxed: a number, which orders nothing by itself.
        let number = self.asked.fetch_add(1, Ordering::Relaxed);
        while self.ended.load(Ordering::Acquire) != number {
            wait();
        }
        Turn(self)
    }

    /// How many were asked for.
    #[cfg(test)]
    pub fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
    }
}

#[derive(Debug)]
pub struct Turn<'a>(&'a Turns);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.ended.fetch_add(1, Ordering::Release);
    }
}
