//! Which process made the sessions. A process that was forked from it has none of the threads of the engines and
//! of the transport: a frame would wait for them for ever, and drops there would free the memory of the other
//! process's sessions.

use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

use pyo3::PyResult;

use crate::errors::misused;

/// The process that first made a session, or boxes of a source on the engines' threads; 0 before.
static FIRST: AtomicU32 = AtomicU32::new(0);

/// Fails in a process that was forked from one with sessions; else this is the process that has them.
pub fn check() -> PyResult<()> {
    let now = process::id();
    // Relaxed: a number that nothing else is read by.
    match FIRST.compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed) {
        Err(first) if first != now => Err(misused(
            "this process was forked from one that has sessions: start it another way, such as multiprocessing's \"spawn\"",
            "Forked",
        )),
        _ => Ok(()),
    }
}

/// Whether this process was forked from one with sessions.
pub fn is_forked() -> bool {
    let first = FIRST.load(Ordering::Relaxed);
    first != 0 && first != process::id()
}

/// Drops an object of the library, or, in a forked process, leaves it to the process that made it.
pub fn drop_here<T>(object: Option<T>) {
    if is_forked() {
        std::mem::forget(object);
    }
}
