//! Boards: what each side writes for the other to read, by the layout of the [wire contract](pairmask_wire::board).
//!
//! A side writes to its own board alone, which the other maps for reading. A number that rises says that an entry
//! holds a new message; the reader copies the entry once, and trusts nothing in the copy.
#![allow(unsafe_code)]

use std::ptr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{SystemTime, UNIX_EPOCH};

use bytemuck::Zeroable;
use pairmask_wire::board::{BOARD_PAGES, BoardWords, ENTRIES_AT, ENTRY_BYTES, Entry, PLACES};
use pairmask_wire::{PAGE_BYTES, Page};

use crate::handshake;
use crate::pool::{Chunk, Pool};
use crate::room::PopulateError;
use crate::segment::Segment;

/// The board that this side writes.
#[derive(Debug)]
pub(super) struct OwnBoard {
    /// Its memory.
    chunk: Chunk,
    address: usize,
}

/// The board of the other side.
#[derive(Debug)]
pub(super) struct TheirBoard {
    /// Its memory.
    _segment: Arc<Segment>,
    address: usize,
}

const fn entry_at(board: usize, place: usize) -> usize {
    board + ENTRIES_AT + place * ENTRY_BYTES
}

impl OwnBoard {
    /// A new board, in memory of a pool.
    pub(super) fn new(pool: &Pool) -> Result<Self, PopulateError> {
        let mut chunk = pool.lend(BOARD_PAGES)?;
        chunk.pages_mut().fill(Page::zeroed());
        let address = chunk.pages().as_ptr().expose_provenance();
        Ok(Self { chunk, address })
    }

    /// Where it lies in its segment.
    pub(super) fn offset(&self) -> u64 {
        self.chunk.offset()
    }

    fn words(&self) -> &BoardWords {
        // SAFETY: a board begins with its words, in a chunk that is held. They are atomic, and any bytes are valid.
        unsafe { &*ptr::with_exposed_provenance(self.address) }
    }

    /// Writes the entry of a place, and says that it is there. Who holds the place calls this, and nobody else.
    pub(super) fn send<H: Copy>(&self, place: usize, number: u64, entry: Entry<H>) {
        assert!(place < PLACES && size_of::<Entry<H>>() <= ENTRY_BYTES, "an entry of the board");
        // SAFETY: the entry lies in the chunk, which is held; nobody refers to it but by its address, and only the
        // holder of the place writes to it.
        unsafe {
            ptr::with_exposed_provenance_mut::<Entry<H>>(entry_at(self.address, place))
                .write_volatile(entry);
        }
        handshake::announce(&self.words().sent[place], number);
    }

    /// Says that the request in a place is sent now.
    pub(super) fn stamp(&self, place: usize) {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let ns = u64::try_from(now.as_nanos()).unwrap_or(u64::MAX);
        self.words().sent_at[place].store(ns, Ordering::Relaxed);
    }

    /// Says that a message of the other side was let go of.
    pub(super) fn release(&self, place: usize, number: u64) {
        handshake::release(&self.words().released[place], number);
    }

    /// Says that this side sleeps from now on: messages that are not seen by a look after this wake it.
    pub(super) fn falls_asleep(&self) {
        handshake::fall_asleep(&self.words().sleeps);
    }

    /// Says that this side looks by itself.
    pub(super) fn wakes_up(&self) {
        handshake::wake_up(&self.words().sleeps);
    }
}

impl TheirBoard {
    /// The board at an offset of a segment; `None` where it does not lie in there.
    pub(super) fn at(segment: Arc<Segment>, offset: u64) -> Option<Self> {
        let address = segment.address(offset, BOARD_PAGES * PAGE_BYTES)?;
        Some(Self { _segment: segment, address })
    }

    fn words(&self) -> &BoardWords {
        // SAFETY: the board lies in a mapping, as was checked, which is held. Its words are atomic, any bytes are valid,
        // and they are only read.
        unsafe { &*ptr::with_exposed_provenance(self.address) }
    }

    /// Number of the last message in a place.
    pub(super) fn sent(&self, place: usize) -> u64 {
        handshake::last(&self.words().sent[place])
    }

    /// When the last message in a place was sent, as the other side says.
    pub(super) fn sent_at(&self, place: usize) -> u64 {
        self.words().sent_at[place].load(Ordering::Relaxed)
    }

    /// Number of the last message of this side in a place that the other has let go of.
    pub(super) fn released(&self, place: usize) -> u64 {
        handshake::last(&self.words().released[place])
    }

    /// Whether the other side is to be woken.
    pub(super) fn sleeps(&self) -> bool {
        handshake::sleeps(&self.words().sleeps)
    }

    /// A copy of an entry.
    pub(super) fn entry<H: bytemuck::AnyBitPattern>(&self, place: usize) -> Entry<H> {
        assert!(place < PLACES && size_of::<Entry<H>>() <= ENTRY_BYTES, "an entry of the board");
        // SAFETY: the entry lies in the board, and any bytes are a valid one. The other side may write to it: volatile,
        // so that it is read once and no more.
        unsafe {
            ptr::with_exposed_provenance::<Entry<H>>(entry_at(self.address, place)).read_volatile()
        }
    }
}
