//! Chunks of the daemon's reply segment that nobody uses, so that their pages can be given back.
//!
//! The transport lends a chunk to one holder at a time: a chunk that is lent to the daemon itself is
//! neither in a client's hands nor on its way to one. The transport lends chunks for answers only, so
//! the daemon is a client of its own port, whose one request is never answered.
//!
//! The pool is a stack: the chunk that came back last is lent first. Chunks that were never lent lie at
//! the bottom, those that steady clients use on top, and so they stay.

use std::time::{Duration, Instant};

use pairmask_wire::{PAGE_BYTES, RequestHeader};

use crate::loans::assume_response_pages;
use crate::memory::remove_pages;
use crate::own_request::{OwnRequest, SentRequest};
use crate::room;
use crate::services::{
    ActiveRequest, ClientPort, OpenError, ResponseLoan, Server, Services, TransportError,
};

/// A port's own request is there with the first look, but where what dead clients left is in its way.
const RECEIVED_WITHIN: Duration = Duration::from_secs(2);
/// Between two looks for it.
const RECEIVE_LOOK: Duration = Duration::from_millis(5);

/// The free chunks of a server port.
pub struct FreeChunks {
    // The loans' request before the request that was sent, and that before its port: fields drop in this order.
    request: ActiveRequest,
    _sent: SentRequest,
    _port: ClientPort,
    /// Size of a chunk's payload.
    chunk_bytes: usize,
}

impl std::fmt::Debug for FreeChunks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FreeChunks").field("chunk_bytes", &self.chunk_bytes).finish_non_exhaustive()
    }
}

/// What its user knows of a free chunk, by the address of its payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChunkLook {
    /// It is to be taken.
    Requested,
    /// It was used, and is not to be taken.
    Other,
    /// It was never used, and so were none of those below it.
    Unused,
}

/// A free chunk. Nobody else reads or writes it.
pub struct FreeChunk {
    loan: ResponseLoan,
}

impl FreeChunk {
    /// Address of its payload.
    pub fn address(&self) -> usize {
        self.loan.payload().as_ptr() as usize
    }
}

impl FreeChunks {
    /// Those of a port, whose chunks have payloads of `chunk_bytes`. Requests of clients that are received meanwhile go
    /// to `others`.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn of(
        services: &Services,
        server: &Server,
        chunk_bytes: u64,
        others: &mut Vec<ActiveRequest>,
    ) -> Result<Self, TransportError> {
        let port = services.client_port(1).map_err(|error| match error {
            OpenError::Transport(error) => error,
            other => TransportError::new("making a port for free chunks", &other),
        })?;
        let sent = OwnRequest::lend(&port, 1)?.send(&RequestHeader::status(0, 0))?;
        let give_up_at = Instant::now() + RECEIVED_WITHIN;
        let request = loop {
            let failed = |what: &dyn std::fmt::Debug| {
                TransportError::new("receiving a request for free chunks", &what)
            };
            match server.receive() {
                Ok(Some(request)) if request.origin() == port.id() => break request,
                Ok(Some(request)) => others.push(request),
                Ok(None) if Instant::now() >= give_up_at => return Err(failed(&"none comes")),
                Err(error) if Instant::now() >= give_up_at => return Err(failed(&error)),
                // A client that died while it connected; the janitor takes the rest away.
                Ok(None) | Err(_) => std::thread::sleep(RECEIVE_LOOK),
            }
        };
        let chunk_bytes = usize::try_from(chunk_bytes).unwrap_or(0) / PAGE_BYTES * PAGE_BYTES;
        Ok(Self { request, _sent: sent, _port: port, chunk_bytes })
    }

    /// Takes a free chunk that is needed, if there is one. For a moment all chunks above it are taken: to be called
    /// in a turn at the port.
    pub fn take(&self, look: impl Fn(usize) -> ChunkLook) -> Option<FreeChunk> {
        // The transport writes to the first page of the chunk that it lends, and the last one may be new.
        if !room::has_page() {
            return None;
        }
        let mut others = Vec::new();
        let mut requested = None;
        while let Some(chunk) = self.lend() {
            match look(chunk.address()) {
                ChunkLook::Requested => {
                    requested = Some(chunk);
                    break;
                }
                ChunkLook::Other => others.push(chunk),
                ChunkLook::Unused => {
                    others.push(chunk);
                    break;
                }
            }
        }
        put_back(others);
        requested
    }

    /// Gives a chunk back, below those that were used: steady clients go on with theirs. As [`Self::take`], to be
    /// called in a turn.
    pub fn put_below(&self, chunk: FreeChunk, look: impl Fn(usize) -> ChunkLook) {
        let mut others = Vec::new();
        if room::has_page() {
            while let Some(other) = self.lend() {
                let is_last = look(other.address()) == ChunkLook::Unused;
                others.push(other);
                if is_last {
                    break;
                }
            }
        }
        // An unused chunk stays below it.
        if others.last().is_some_and(|last| look(last.address()) == ChunkLook::Unused) {
            drop(others.pop());
        }
        drop(chunk);
        put_back(others);
    }

    /// Gives the first `bytes` bytes of a chunk's payload back to the system: they read as zeros, and become present
    /// again when they are written to. Whether the system did.
    pub fn remove_pages(&self, chunk: &mut FreeChunk, bytes: usize) -> bool {
        remove_pages(&mut chunk.loan, bytes.min(self.chunk_bytes))
    }

    fn lend(&self) -> Option<FreeChunk> {
        let loan = self.request.loan_slice_uninit(1).ok()?;
        Some(FreeChunk { loan: assume_response_pages(loan) })
    }
}

/// Gives chunks back so that they lie as they lay before they were lent one by one.
fn put_back(mut chunks: Vec<FreeChunk>) {
    while let Some(last) = chunks.pop() {
        drop(last);
    }
}
