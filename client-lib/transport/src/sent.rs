//! Requests on their way, and what comes back.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use pairmask_wire::board::{Entry, Placed};
use pairmask_wire::{Page, ReplyError, RequestHeader, ResponseHeader, StatusCode, page_count};

use crate::link::{Link, Place, Slot};
use crate::link_error::LinkError;
use crate::locked::lock;
use crate::pool::Chunk;
use crate::process_limits;
use crate::segment::Segment;
use crate::vigil::{Seen, Vigil};

/// A request for which there is no place is tried again this often: a daemon that is not culling receives
/// within a few µs.
const ROOM_INTERVAL: Duration = Duration::from_micros(50);
/// A daemon that makes no room for this long is silent. It culls its largest frames in less, and receives
/// between two frames.
const ROOM_WITHIN: Duration = Duration::from_secs(1);

/// Shared memory for a request.
pub struct SharedFrame {
    /// Its memory.
    pub loan: Chunk,
    /// Number of the segment that it lies in.
    segment: u64,
    /// The slot that it holds.
    pub slot: Slot,
}

/// A request that could not be sent.
pub struct Unsent {
    error: LinkError,
    frame: SharedFrame,
}

impl Unsent {
    /// Why it was not sent.
    pub const fn error(&self) -> &LinkError {
        &self.error
    }

    /// The pages of the request.
    pub fn pages(&self) -> &[Page] {
        self.frame.loan.pages()
    }

    /// Why it was not sent.
    pub fn into_error(self) -> LinkError {
        self.error
    }
}

/// A request under way. Dropped, it lets go of its answer, whether that has come or not.
pub(super) struct SentRequest {
    link: Arc<Link>,
    place: usize,
    number: u64,
    /// `None` only while it is dropped.
    chunk: Option<Chunk>,
}

fn pages_of(bytes: u64) -> usize {
    page_count(bytes) as usize
}

impl SharedFrame {
    /// Sends the frame and wakes the daemon. Waits for a place where the daemon still reads what the session sent, and
    /// dropped, before.
    #[allow(clippy::result_large_err)] // The error holds the request, which a frame goes on with.
    pub(super) fn send(self, header: &RequestHeader) -> Result<(SentRequest, Slot), Unsent> {
        let place = match self.slot.link().await_place() {
            Ok(place) => place,
            Err(error) => return Err(Unsent { error, frame: self }),
        };
        let Self { loan, segment, slot } = self;
        let link = Arc::clone(slot.link());
        let number = link.next.fetch_add(1, Ordering::Relaxed);
        let (offset, pages) = (loan.offset(), loan.pages().len() as u64);
        let placed = Placed { segment, offset, pages };
        link.own.stamp(place);
        link.own.send(place, number, Entry { placed, header: *header });
        if link.theirs.sleeps() {
            link.bell.ring();
        }
        Ok((SentRequest { link, place, number, chunk: Some(loan) }, slot))
    }
}

impl SharedFrame {
    /// Memory for `bytes` bytes, in the place of a frame.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn lend(slot: Slot, bytes: u64) -> Result<Self, LinkError> {
        let (loan, segment) = slot.link().lend(pages_of(bytes))?;
        Ok(Self { loan, segment, slot })
    }

    /// The frame in memory of so many bytes, with a copy of the first `used` bytes, where it has fewer.
    /// The error holds the frame, for a caller that goes on with it.
    ///
    /// # Errors
    /// [`LinkError`].
    #[allow(clippy::result_large_err)] // As above.
    pub fn enlarged(self, bytes: u64, used: u64) -> Result<Self, (LinkError, Self)> {
        let (pages, used) = (pages_of(bytes), pages_of(used));
        if pages <= self.loan.pages().len() {
            return Ok(self);
        }
        let (mut loan, segment) = match self.slot.link().lend(pages) {
            Ok(lent) => lent,
            Err(error) => return Err((error, self)),
        };
        loan.pages_mut()[..used].copy_from_slice(&self.loan.pages()[..used]);
        Ok(Self { loan, segment, ..self })
    }
}

impl Link {
    /// Memory for `bytes` bytes of objects, populated.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn loan(self: &Arc<Self>, bytes: u64) -> Result<SharedFrame, LinkError> {
        SharedFrame::lend(Slot::take(self).ok_or(LinkError::TooManyFrames)?, bytes)
    }

    fn await_place(&self) -> Result<usize, LinkError> {
        if !self.is_own() {
            return Err(LinkError::Died);
        }
        if let Some(place) = self.take_place() {
            return Ok(place);
        }
        let since = Instant::now();
        let mut vigil = Vigil::default();
        loop {
            std::thread::sleep(ROOM_INTERVAL);
            if let Some(place) = self.take_place() {
                return Ok(place);
            }
            let waited = since.elapsed();
            match vigil.look_at_times(&self.watched()) {
                Seen::Dead => return Err(LinkError::Died),
                Seen::Running if waited < ROOM_WITHIN => {}
                Seen::Running | Seen::Silent => return Err(LinkError::Timeout { waited }),
            }
        }
    }
}

impl SentRequest {
    /// The pages of the request.
    pub(super) fn pages(&self) -> &[Page] {
        self.chunk.as_ref().map_or(&[], Chunk::pages)
    }

    /// Whether the answer has come.
    pub(super) fn is_answered(&self) -> bool {
        self.link.theirs.sent(self.place) == self.number
    }

    /// The answer that has come: a copy of its header, and its memory.
    ///
    /// # Errors
    /// [`LinkError`] where it does not lie in the daemon's memory, or that cannot be mapped.
    pub(super) fn answer(&self) -> Result<(ResponseHeader, CheckedResponse), LinkError> {
        let Entry { placed, header } = self.link.theirs.entry::<ResponseHeader>(self.place);
        let malformed = LinkError::Reply(ReplyError::Malformed { field: "place" });
        let Some(segment) = self.link.segment(placed.segment) else {
            return Err(process_limits::behind(0).map_or(malformed, LinkError::Limit));
        };
        self.link.has_answered.store(true, Ordering::Relaxed);
        if header.status == StatusCode::OverBudget as u32 {
            self.link.is_over_budget.store(true, Ordering::Relaxed);
        }
        Ok((header, CheckedResponse { segment, placed }))
    }
}

impl Drop for SentRequest {
    fn drop(&mut self) {
        let Self { link, place, number, chunk } = self;
        if !link.is_own() {
            return;
        }
        link.own.release(*place, *number);
        let done = link.is_done(*place, *number);
        let left = chunk.take().filter(|_| !done);
        let state = left.map_or(Place::Free, |chunk| Place::Left { number: *number, chunk });
        lock(&link.places)[*place] = state;
    }
}

/// The payload of an answer, in the daemon's memory. It holds what its request says until that is dropped.
pub struct CheckedResponse {
    segment: Arc<Segment>,
    placed: Placed,
}

impl CheckedResponse {
    /// The payload; none where it does not lie in the daemon's memory.
    pub fn pages(&self) -> &[Page] {
        self.segment.pages(self.placed.offset, self.placed.pages)
    }
}
