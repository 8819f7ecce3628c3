//! Boards: where each side says what it has sent, and what it has let go of.
//!
//! A board is three pages that one side writes and the other reads. It has [`PLACES`] places. A message is
//! an entry in a place, and a number. A client counts its requests, from 1; an answer has its request's number.

use std::sync::atomic::AtomicU64;

use crate::PAGE_BYTES;

/// Messages that a client may have under way at a time, abandoned ones that the daemon still reads among them.
pub const PLACES: usize = 8;

/// Pages of a board: one of words, and two of entries.
pub const BOARD_PAGES: usize = 3;

/// Offset of the first entry in a board, bytes.
pub const ENTRIES_AT: usize = PAGE_BYTES;

/// Bytes from one entry to the next.
pub const ENTRY_BYTES: usize = 512;

/// The first page of a board.
#[derive(Debug)]
#[repr(C, align(64))]
pub struct BoardWords {
    /// Number of the last message in each place: of a client the requests, of a daemon the answers.
    pub sent: [AtomicU64; PLACES],
    /// Number of the last message of the other side that was let go of, in each place. A client lets go of an answer,
    /// also before it has come; a daemon of a request that it does not answer.
    pub released: [AtomicU64; PLACES],
    /// Whether this side sleeps and is to be woken; 0 while it looks by itself.
    pub sleeps: AtomicU64,
    reserved: [u64; 7],
    /// When the request in each place was sent, nanoseconds of the system's clock; 0 is not known. Requests of
    /// several clients that a daemon finds at one look are taken in this order.
    pub sent_at: [AtomicU64; PLACES],
}

/// Where the pages of a message lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Placed {
    /// Number of the sender's segment, in the order in which it has sent their descriptors, from 0.
    pub segment: u64,
    /// Offset of the first page in the segment's file, bytes.
    pub offset: u64,
    /// Number of pages.
    pub pages: u64,
}

/// An entry of a board: a message.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Entry<H> {
    /// Its payload.
    pub placed: Placed,
    /// Its header.
    pub header: H,
}

const _: () = {
    assert!(size_of::<BoardWords>() == 256 && size_of::<Placed>() == 24);
    assert!(size_of::<Entry<crate::ResponseHeader>>() <= ENTRY_BYTES);
    assert!(size_of::<Entry<crate::RequestHeader>>() <= ENTRY_BYTES);
    assert!(ENTRIES_AT + PLACES * ENTRY_BYTES <= BOARD_PAGES * PAGE_BYTES);
};
