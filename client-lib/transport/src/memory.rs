//! Population of shared memory before it is written to.
#![allow(unsafe_code)]

use pairmask_wire::board::BOARD_PAGES;
use pairmask_wire::{PAGE_BYTES, Page};
use rustix::io::Errno;
use rustix::mm::{Advice, madvise};

use crate::room::{self, PopulateError};

/// Makes every page of `memory` present. A full /dev/shm is then an error here and not a SIGBUS at
/// the first write, and no frame pays for page faults (24 MB cost 23 to 33 ms at first touch and
/// 0.8 ms after).
///
/// # Errors
/// [`PopulateError`] when there is no memory. A kernel before 5.14 has no such call: then nothing
/// is checked, and pages become present at first touch.
pub fn populate<T>(memory: &mut [T]) -> Result<(), PopulateError> {
    let bytes = size_of_val(memory);
    let start = memory.as_mut_ptr() as usize;
    let first_page = start & !(PAGE_BYTES - 1);
    let length = (start + bytes).next_multiple_of(PAGE_BYTES) - first_page;
    if bytes == 0 {
        return Ok(());
    }
    // SAFETY: the range is the pages of a live exclusive slice; MADV_POPULATE_WRITE changes no
    // byte of it, it only makes the pages present.
    match unsafe { madvise(first_page as *mut _, length, Advice::LinuxPopulateWrite) } {
        Ok(()) | Err(Errno::INVAL) => Ok(()),
        Err(_) => Err(PopulateError { bytes: bytes as u64 }),
    }
}

/// What may come out of the reserve of /dev/shm: a board.
const FROM_RESERVE: usize = BOARD_PAGES * PAGE_BYTES;

/// Bytes that are populated from one look whether they are wanted to the next: some 3 ms.
const AT_ONCE: usize = 8 << 20;

/// As [`populate`], of memory of which the first `known_bytes` are present, as long as `is_wanted`. Chunks of more than a
/// board leave a reserve of /dev/shm free for the pages that the transport writes.
///
/// # Errors
/// As [`populate`], and where it is not wanted any more.
pub(super) fn populate_beyond(
    chunk: &mut [Page],
    known_bytes: usize,
    is_wanted: impl Fn() -> bool,
) -> Result<(), PopulateError> {
    let bytes = size_of_val(chunk);
    if known_bytes >= bytes {
        return Ok(());
    }
    // A board may come out of the reserve, and so may the answer that there is no memory.
    if bytes > FROM_RESERVE {
        room::for_payload((bytes - known_bytes) as u64)?;
    }
    let known_pages = known_bytes / PAGE_BYTES;
    for part in chunk[known_pages..].chunks_mut(AT_ONCE / PAGE_BYTES) {
        if !is_wanted() {
            return Err(PopulateError { bytes: bytes as u64 });
        }
        populate(part)?;
    }
    Ok(())
}
