//! A logger that captures the library's log lines for tests.

use std::sync::{Mutex, Once, PoisonError};

use log::{Level, LevelFilter, Log, Metadata, Record};

struct CapturedLines(Mutex<Vec<(Level, String)>>);

static CAPTURED: CapturedLines = CapturedLines(Mutex::new(Vec::new()));

impl Log for CapturedLines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("pairmask::")
    }
    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            let line = (record.level(), record.args().to_string());
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    }
    fn flush(&self) {}
}

/// Captures the library's log lines of this level and above from now on, and forgets those of before. A process has
/// one log: tests that look at it run one after the other.
pub fn capture(level: LevelFilter) {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| log::set_logger(&CAPTURED).expect("the process has no other logger"));
    log::set_max_level(level);
    take_captured();
}

/// Takes the lines that were captured since the last call.
pub fn take_captured() -> Vec<(Level, String)> {
    std::mem::take(&mut CAPTURED.0.lock().unwrap_or_else(PoisonError::into_inner))
}
