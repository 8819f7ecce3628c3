//! Room in shared memory for what the transport writes by itself.
//!
//! Ports, connections and chunk headers are the transport's, which writes to their pages without
//! asking whether the system has any: with a full /dev/shm that is a SIGBUS, in a client that
//! connects or in a daemon that takes it in. So whoever is about to make some looks whether there
//! is room, and what Pairmask itself fills with boxes and masks leaves a reserve free for it.
//!
//! The look is no lock. What remains is a program other than Pairmask that fills the last
//! [`RESERVE_BYTES`] within the millisecond between a look and the transport's writing.

use rustix::fs::{StatVfs, statvfs};

use crate::instance::SHM_DIR;

/// The system has no memory for these pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no shared memory for {bytes} bytes: free space in /dev/shm or make it larger")]
pub struct PopulateError {
    /// Bytes asked for.
    pub bytes: u64,
}

/// Room that making ports takes at most: those of a client write to 10 pages, in the client and in
/// the daemon, and a daemon's to 7. Three times that, for larger `--max-clients`.
pub(super) const PORTS_BYTES: u64 = 128 << 10;

/// What boxes and masks leave free: room for two clients that connect at the same moment, and for
/// the one page each of replies that say that there is no memory. Larger would be missed where
/// /dev/shm is small; without it, a client that fills /dev/shm with boxes would kill the next one
/// that connects.
const RESERVE_BYTES: u64 = 2 * PORTS_BYTES;

/// Free bytes of a file system; `None` where it has no limit.
fn free_bytes(of: &StatVfs) -> Option<u64> {
    // A tmpfs without a limit says that it has no blocks at all.
    (of.f_blocks != 0).then(|| of.f_bavail.saturating_mul(of.f_frsize))
}

/// Checks that so many bytes can be had in shared memory, and so many more.
fn check(bytes: u64, more: u64) -> Result<(), PopulateError> {
    // Where it cannot be asked, it cannot be full for us: the transport's own error says more.
    let free = statvfs(SHM_DIR).ok().as_ref().and_then(free_bytes);
    if free.is_none_or(|free| free >= bytes.saturating_add(more)) {
        Ok(())
    } else {
        Err(PopulateError { bytes })
    }
}

/// Checks that there is room for the ports of a client or a daemon.
///
/// # Errors
/// [`PopulateError`].
pub(super) fn for_ports() -> Result<(), PopulateError> {
    check(PORTS_BYTES, 0)
}

/// Checks that there is room for so many bytes of boxes or masks beside the reserve.
///
/// # Errors
/// [`PopulateError`].
pub(super) fn for_payload(bytes: u64) -> Result<(), PopulateError> {
    check(bytes, RESERVE_BYTES)
}
