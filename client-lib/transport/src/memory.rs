//! Population of shared memory before it is written to.
#![allow(unsafe_code)]

use std::collections::HashMap;

use pairmask_wire::PAGE_BYTES;
use rustix::io::Errno;
use rustix::mm::{Advice, madvise};

use crate::room::{self, PopulateError};
use crate::services::ResponseLoan;

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

/// How much of each chunk is populated, so that steady frames skip the call.
///
/// Chunks are distinguished by their addresses: a port reuses few of them.
#[derive(Debug, Default)]
pub struct Populated {
    bytes_at: HashMap<usize, usize>,
}

impl Populated {
    /// As [`populate`], unless as much of the chunk at this address was populated before. Chunks of
    /// more than a page leave a reserve of /dev/shm free for the pages that the transport writes.
    ///
    /// # Errors
    /// As [`populate`].
    pub fn ensure<T>(&mut self, chunk: &mut [T]) -> Result<(), PopulateError> {
        let known_bytes = self.bytes_at.entry(chunk.as_ptr() as usize).or_default();
        populate_beyond(chunk, *known_bytes)?;
        *known_bytes = size_of_val(chunk).max(*known_bytes);
        Ok(())
    }
}

/// Populates a chunk of which `known_bytes` are. As [`Populated::ensure`], where its user keeps what is known.
///
/// # Errors
/// As [`populate`].
pub fn populate_beyond<T>(chunk: &mut [T], known_bytes: usize) -> Result<(), PopulateError> {
    let bytes = size_of_val(chunk);
    if known_bytes >= bytes {
        return Ok(());
    }
    // A single page may come out of the reserve: the reply that there is no memory needs one.
    if bytes > PAGE_BYTES {
        room::for_payload((bytes - known_bytes) as u64)?;
    }
    populate(chunk)
}

/// Gives the pages of the first `bytes` bytes of a loan's payload back to the system. A loan is one of a whole chunk, and
/// `bytes` is at most the payload of a chunk, regardless of the length that was asked for. Whether the system did.
pub(super) fn remove_pages(loan: &mut ResponseLoan, bytes: usize) -> bool {
    let first = loan.payload_mut().as_mut_ptr();
    debug_assert!(bytes.is_multiple_of(PAGE_BYTES));
    if bytes == 0 {
        return true;
    }
    // SAFETY: the range lies in the chunk that this loan holds alone, in a shared writable mapping that lives as long
    // as the loan. No reference into it exists but through the loan, which is borrowed here; the pages read as
    // zeros afterwards, and every value is a valid Page.
    unsafe { madvise(first.cast(), bytes, Advice::LinuxRemove) }.is_ok()
}
