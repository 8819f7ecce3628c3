//! The heap's memory that nobody uses.
#![allow(unsafe_code)]

/// Gives it back to the system: what the allocator keeps of a client that is gone would count as the daemon's own. Takes a
/// millisecond or more, so for a thread that serves nobody.
pub(super) fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: the call takes no memory that is in use, and may be made by any thread at any time.
    unsafe {
        libc::malloc_trim(0);
    }
}
