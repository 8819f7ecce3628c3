//! Limits of this process: open files and address space.
//!
//! The transport says of a step that failed little more than that it failed. What this process lacks is
//! found out afterwards, by looking for it.

use std::fs::File;
use std::path::Path;

use rustix::io::Errno;
use rustix::param::page_size;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// A limit of this process that does not let it connect, serve or send.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LimitError {
    /// No more files can be opened.
    #[error(
        "this process may have {limit} open files and needs more (RLIMIT_NOFILE): raise it with `ulimit -n`"
    )]
    Files {
        /// The soft limit.
        limit: u64,
    },
    /// Memory of the other side, or of its own, cannot be mapped.
    #[error(
        "{} MiB of shared memory do not fit the address space of this process, {} MiB (RLIMIT_AS): raise it with `ulimit -v`", bytes >> 20, limit >> 20
    )]
    AddressSpace {
        /// Bytes to be mapped.
        bytes: u64,
        /// The soft limit, bytes.
        limit: u64,
    },
}

/// Files that a step of the transport opens at a time, at most.
const FILES_OF_A_STEP: usize = 8;

/// The limit of open files where this process has reached it, as far as a step of the transport needs some.
pub fn no_files_left() -> Option<LimitError> {
    // Some that it opened are closed again.
    let opened: Result<Vec<File>, _> =
        (0..FILES_OF_A_STEP).map(|_| File::open(Path::new("/dev/null"))).collect();
    let limit = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let is_none_left = opened.is_err_and(|e| e.raw_os_error() == Some(Errno::MFILE.raw_os_error()));
    is_none_left.then_some(LimitError::Files { limit })
}

/// The limit behind a step that failed, which was to map so many bytes; `None` where there is room.
pub(super) fn behind(bytes: u64) -> Option<LimitError> {
    if let Some(limit) = no_files_left() {
        return Some(limit);
    }
    let limit = getrlimit(Resource::As).current?;
    let is_short = address_space_left().is_some_and(|left| left < bytes);
    is_short.then_some(LimitError::AddressSpace { bytes, limit })
}

/// Bytes that this process may still map; `None` without a limit.
fn address_space_left() -> Option<u64> {
    let limit = getrlimit(Resource::As).current?;
    let mapped = sizes().map_or(0, |[mapped, ..]| mapped);
    Some(limit.saturating_sub(mapped))
}

/// Bytes that this process has mapped, that are present of them, and that a file is behind of these; `None` where the
/// kernel does not say.
pub(super) fn sizes() -> Option<[u64; 3]> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages = statm.split_ascii_whitespace().map_while(|pages| pages.parse::<u64>().ok());
    let bytes: Vec<u64> = pages.take(3).map(|pages| pages * page_size() as u64).collect();
    bytes.try_into().ok()
}

/// Raises the soft limit of open files to the hard one: a worker needs several for each client, and the
/// usual soft limit of 1024 is for programs that use `select`. Returns what the process may have.
pub fn raise_file_limit() -> Option<u64> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return maximum;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => maximum,
        Err(_) => current,
    }
}
