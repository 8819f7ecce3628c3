//! What stands in a recording.

use pairmask_wire::{PAGE_BYTES, Reject, Request, RequestHeader, page_count};

use super::Answered;

/// The largest payload that is recorded: that of 2.8 million boxes. A session that sends more is not recorded from there
/// on. A reader allocates no more for one.
pub const MOST_PAYLOAD_BYTES: usize = 64 << 20;

/// Something that a daemon has noted.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Time since the recording began, ns: of a request when its client sent it.
    pub at_ns: u64,
    pub event: Event,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A request that is valid.
    Request {
        session: u64,
        /// Counts from 1 through all sessions.
        number: u64,
        header: Box<RequestHeader>,
        /// The payload up to the end of its last section. What lies between sections is zero.
        payload: Vec<u8>,
    },
    /// The answer to a request. A request whose client did not wait for the answer may have none.
    Answer { number: u64, answered: Answered },
    /// A session is recorded no further.
    SessionEnded { session: u64, why: SessionEnd },
    /// A worker begins: all sessions before have ended.
    WorkerBegan,
}

/// Why a session is recorded no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionEnd {
    /// Its client disconnected.
    Disconnected,
    /// Its requests came faster than they were written.
    TooFast,
    /// A request is larger than [`MOST_PAYLOAD_BYTES`].
    TooLarge,
}

impl SessionEnd {
    pub(super) const ALL: [Self; 3] = [Self::Disconnected, Self::TooFast, Self::TooLarge];

    /// Whether requests of the session may be missing.
    pub const fn is_early(self) -> bool {
        !matches!(self, Self::Disconnected)
    }
}

/// The request that a header says, with a payload of so many bytes.
pub(super) fn parsed(header: &RequestHeader, payload_bytes: usize) -> Result<Request, Reject> {
    Request::parse(header, page_count(payload_bytes as u64) * PAGE_BYTES as u64)
}

/// The sections of a payload, and zeros between them. `None` where that is more than is recorded.
pub(super) fn copied(header: &RequestHeader, payload: &[u8]) -> Option<Vec<u8>> {
    let ranges = || {
        let used = header.sections.iter().filter(|section| section.is_used());
        used.filter_map(|section| {
            let start = usize::try_from(section.offset).ok()?;
            let end = start.checked_add(usize::try_from(section.bytes).ok()?)?;
            // One that leaves the payload is none that a daemon reads.
            (end <= payload.len()).then_some(start..end)
        })
    };
    let end = ranges().map(|range| range.end).max().unwrap_or(0);
    if end > MOST_PAYLOAD_BYTES {
        return None;
    }
    let mut copy = vec![0; end];
    for range in ranges() {
        copy[range.clone()].copy_from_slice(&payload[range]);
    }
    Some(copy)
}
