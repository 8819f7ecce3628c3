//! Whether this process is the one that made something, or a child that was forked from it.
//!
//! A child has all that its parent had mapped: the same memory, the same sockets. What it wrote there would be its parent's
//! words, and what it dropped would be taken from under its parent. It leaves all of that alone, and connects by itself.
#![allow(unsafe_code)]

use std::sync::Once;
use std::sync::atomic::{AtomicU32, Ordering};

/// Forks on the way from the first process to this one.
static FORKS: AtomicU32 = AtomicU32::new(0);

extern "C" fn count() {
    FORKS.fetch_add(1, Ordering::Relaxed);
}

/// The process that made something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Maker {
    forks: u32,
    process: u32,
}

impl Maker {
    /// This process.
    pub(super) fn here() -> Self {
        static COUNTED: Once = Once::new();
        COUNTED.call_once(|| {
            // SAFETY: the handler adds to a number, which may be done at any time. It stays as long as the program.
            let failed = unsafe { libc::pthread_atfork(None, None, Some(count)) };
            if failed != 0 {
                log::warn!("a forked child will not be distinguished from its parent");
            }
        });
        Self { forks: FORKS.load(Ordering::Relaxed), process: std::process::id() }
    }

    /// Whether it is this process, and no parent of it.
    pub(super) fn is_here(self) -> bool {
        self.forks == FORKS.load(Ordering::Relaxed)
    }

    /// As [`is_here`](Self::is_here), also of a child that was made without what libc does at a fork, by the kernel's word:
    /// a system call.
    pub(super) fn is_here_by_its_id(self) -> bool {
        self.is_here() && self.process == std::process::id()
    }
}
