//! Room in shared memory for the pages that the transport writes by itself.
//!
//! The transport writes its bookkeeping without asking whether the system has free pages. With a full /dev/shm that is a
//! SIGBUS, in a client that connects or in the daemon that lets it in. A process therefore checks for room before it
//! makes a pool, and boxes and masks leave a reserve free.
//!
//! The check is no lock. One case remains: another program fills the last [`RESERVE_BYTES`] within
//! the millisecond between the check and the transport's writing.

use rustix::fs::{StatVfs, statvfs};

use crate::instance::SHM_DIR;

/// The system has no memory for these pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no shared memory for {bytes} bytes: free space in /dev/shm or make it larger")]
pub struct PopulateError {
    /// Bytes asked for.
    pub bytes: u64,
}

/// Room that must be free before a pool is made, which writes to a page for each of its pieces, a dozen at most, and to as
/// many of its bookkeeping. All of them but the board's are free again a moment later.
pub(super) const POOL_BYTES: u64 = 128 << 10;

/// Bytes that boxes and masks leave free: room for a client that connects, on both sides, and for boards and replies of
/// one page that say that there is no memory. A larger reserve would be missing
/// where /dev/shm is small. Without a reserve, a client that fills /dev/shm with boxes would kill
/// the next one that connects.
const RESERVE_BYTES: u64 = 2 * POOL_BYTES;

/// Free bytes of a file system; `None` where it has no limit.
fn free_bytes(of: &StatVfs) -> Option<u64> {
    // A tmpfs without a limit reports 0 blocks.
    (of.f_blocks != 0).then(|| of.f_bavail.saturating_mul(of.f_frsize))
}

/// Checks that shared memory has `bytes` + `more` free bytes.
fn check(bytes: u64, more: u64) -> Result<(), PopulateError> {
    // Without figures of the file system nothing is refused here: the transport's own error says
    // more.
    let free = statvfs(SHM_DIR).ok().as_ref().and_then(free_bytes);
    if free.is_none_or(|free| free >= bytes.saturating_add(more)) {
        Ok(())
    } else {
        Err(PopulateError { bytes })
    }
}

/// Checks that there is room for a pool.
pub(super) fn for_pool() -> Result<(), PopulateError> {
    check(POOL_BYTES, 0)
}

/// Checks that there is room for `bytes` bytes of boxes or masks beside the reserve.
pub(super) fn for_payload(bytes: u64) -> Result<(), PopulateError> {
    check(bytes, RESERVE_BYTES)
}
