//! The worker thread that leads may sleep while another one leaves a frame with a GPU: one of the two publishes it.
//!
//! The one says that it sleeps before it looks for frames, and the other leaves the frame before it looks who sleeps. A
//! fence stands between the two steps of each, so that one of the two sees the other. A test runs this file under a
//! model of memory (`tests/tests/cpu/memory_model`), so it names `super::atomic`.

use super::atomic::{AtomicBool, Ordering, fence};

#[derive(Default)]
pub struct Sleeper {
    is_asleep: AtomicBool,
}

impl Sleeper {
    /// Sleeps, unless a GPU is busy. Whether one is.
    pub fn sleep_unless(&self, is_busy: impl FnOnce() -> bool, sleep: impl FnOnce()) -> bool {
        self.is_asleep.store(true, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        let is_busy = is_busy();
        if !is_busy {
            sleep();
        }
        self.is_asleep.store(false, Ordering::Relaxed);
        is_busy
    }

    /// What another thread, that may have left a frame with a GPU before, sees of the leader.
    pub fn watch(&self) -> Watch<'_> {
        fence(Ordering::SeqCst);
        Watch(self)
    }
}

/// A view of a leader that may sleep.
pub struct Watch<'a>(&'a Sleeper);

impl Watch<'_> {
    /// Whether the leader sleeps.
    pub fn is_asleep(&self) -> bool {
        self.0.is_asleep.load(Ordering::Relaxed)
    }
}
