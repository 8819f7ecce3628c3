//! Population of shared memory before it is written to.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use pairmask_wire::PAGE_BYTES;
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

/// How much of each chunk is populated, so that steady frames skip the call.
///
/// Chunks are told apart by their addresses: a port reuses few of them.
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
        let known_bytes = self.known_bytes(chunk);
        populate_beyond(chunk, known_bytes)?;
        self.note(chunk);
        Ok(())
    }

    /// Bytes that are known to be populated of the chunk at this address.
    fn known_bytes<T>(&self, chunk: &[T]) -> usize {
        self.bytes_at.get(&(chunk.as_ptr() as usize)).copied().unwrap_or(0)
    }

    /// Notes that a chunk is populated.
    fn note<T>(&mut self, chunk: &[T]) {
        let bytes = self.bytes_at.entry(chunk.as_ptr() as usize).or_default();
        *bytes = size_of_val(chunk).max(*bytes);
    }
}

/// [`Populated`] for several threads, each with chunks of its own at a time. While one populates a
/// chunk, which may take tens of milliseconds, the others do not wait.
#[derive(Debug, Default)]
pub struct SharedPopulated(Mutex<Populated>);

impl SharedPopulated {
    /// As [`Populated::ensure`].
    ///
    /// # Errors
    /// As [`populate`].
    pub fn ensure<T>(&self, chunk: &mut [T]) -> Result<(), PopulateError> {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known_bytes = known().known_bytes(chunk);
        if known_bytes >= size_of_val(chunk) {
            return Ok(());
        }
        populate_beyond(chunk, known_bytes)?;
        known().note(chunk);
        Ok(())
    }
}

/// Populates a chunk of which `known_bytes` are.
fn populate_beyond<T>(chunk: &mut [T], known_bytes: usize) -> Result<(), PopulateError> {
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
