//! Waiting with a time limit.

use std::time::{Duration, Instant};

/// Waits until `check` gives something.
///
/// # Panics
/// When it does not within `patience`.
pub fn within<T>(patience: Duration, what: &str, mut check: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = check() {
            return value;
        }
        assert!(start.elapsed() < patience, "waited {patience:?} in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}
