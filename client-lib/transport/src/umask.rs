//! Work of the transport that changes the umask.
//!
//! The transport binds a listener's socket under a umask of its own and then sets the old one again.
//! The umask is the whole process's: files that the application creates meanwhile would lack rights, and
//! of two threads that do so at once, the second takes the first one's umask for the old one and leaves
//! it set for good.
#![allow(unsafe_code)]

use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};
use std::thread;

use rustix::thread::{UnshareFlags, unshare_unsafe};

/// Does `work` in a thread that has a umask of its own; the process's stays as it is.
///
/// Where a sandbox forbids such a thread, callers take turns in place of it: the umask changes for some
/// microseconds, but comes back.
pub fn with_own_umask<R: Send>(work: impl Fn() -> R + Sync) -> R {
    static TURN: Mutex<()> = Mutex::new(());
    let apart = || {
        // SAFETY: of what a thread may stop sharing, only file descriptors are a danger to others. `FS`
        // is the umask, the root and the working directory.
        unsafe { unshare_unsafe(UnshareFlags::FS) }.ok().map(|()| work())
    };
    let done = thread::scope(|scope| {
        let thread = thread::Builder::new().name("pairmask-umask".into());
        let spawned = thread.spawn_scoped(scope, apart).ok()?;
        spawned.join().unwrap_or_else(|panic| resume_unwind(panic))
    });
    done.unwrap_or_else(|| {
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        work()
    })
}
