//! Tests that own what a process has once: its logger, its allocator, a device that they lose. They run one after the
//! other: each holds [`alone`].
#![allow(clippy::unwrap_used)]

use std::sync::{Mutex, MutexGuard, PoisonError};

mod allocations;
mod forward_compatibility;
mod library_log;
mod scene_device_loss;

/// The process, for one test at a time. A test that failed leaves it as good as before.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}
