//! A request and its answer.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_wire::{Page, RequestHeader, ResponseHeader};

use crate::link::{Link, Slot};
use crate::link_error::LinkError;
use crate::sent::{CheckedResponse, SentRequest, SharedFrame, Unsent};
use crate::vigil::Vigil;

/// A request that was sent. Dropping it discards the answer.
pub struct Exchange {
    pending: SentRequest,
    slot: Slot,
    at: Instant,
    vigil: Vigil,
    /// After what time the answer came, or why there will be none.
    came: Option<Result<Duration, LinkError>>,
}

/// The answer to a request. Its memory is held until it is dropped.
pub struct Answer {
    /// A copy, not validated yet.
    pub header: ResponseHeader,
    /// Where its words lie.
    pub memory: AnswerMemory,
    /// From the request to the answer.
    pub round_trip: Duration,
}

/// The memory of an answer: the daemon's until its request is dropped.
pub struct AnswerMemory {
    response: CheckedResponse,
    _pending: SentRequest,
    _slot: Slot,
}

impl AnswerMemory {
    /// The pages of the answer.
    pub fn pages(&self) -> &[Page] {
        self.response.pages()
    }
}

impl Exchange {
    /// Sends a request.
    ///
    /// # Errors
    /// [`Unsent`].
    #[allow(clippy::result_large_err)] // The error holds the request, which a frame goes on with.
    pub fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, Unsent> {
        let at = Instant::now();
        let (pending, slot) = shared.send(header)?;
        Ok(Self { pending, slot, at, vigil: Vigil::default(), came: None })
    }

    /// The connection.
    pub const fn link(&self) -> &Arc<Link> {
        self.slot.link()
    }

    /// The pages of the request.
    pub fn pages(&self) -> &[Page] {
        self.pending.pages()
    }

    /// Ends the request. Its place is free for another one.
    pub fn into_slot(self) -> Slot {
        self.slot
    }

    /// Waits until then for the answer, or for what says that there will be none. Whether either has come.
    pub fn has_come(&mut self, expected: Expected, spin: Duration, until: Instant) -> bool {
        if self.came.is_none() {
            let Self { pending, slot, at, vigil, .. } = self;
            self.came = match slot.link().receive(pending, *at, expected, spin, until, vigil) {
                Ok(true) => Some(Ok(at.elapsed())),
                Ok(false) => None,
                Err(error) => Some(Err(error)),
            };
        }
        self.came.is_some()
    }

    /// As [`has_come`](Self::has_come), for whom the answer does not matter yet.
    pub fn has_come_by(&mut self, until: Instant) -> bool {
        self.has_come(Expected::default(), Duration::ZERO, until)
    }

    /// Whether what has come is an answer.
    pub const fn is_answered(&self) -> bool {
        matches!(self.came, Some(Ok(_)))
    }

    /// Takes the answer that has come: a copy of its header, its memory, and the time since the request.
    ///
    /// # Errors
    /// [`LinkError`]; a [`Timeout`](LinkError::Timeout) where nothing has come.
    pub fn take(&mut self) -> Result<(ResponseHeader, CheckedResponse, Duration), LinkError> {
        let timeout = || Err(LinkError::Timeout { waited: self.at.elapsed() });
        let round_trip = self.came.take().unwrap_or_else(timeout)?;
        let (header, response) = self.pending.answer()?;
        Ok((header, response, round_trip))
    }

    /// Waits for the answer, at most `deadline`.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn end(
        mut self,
        expected: Expected,
        spin: Duration,
        deadline: Duration,
    ) -> Result<Answer, LinkError> {
        if !self.has_come(expected, spin, Instant::now() + deadline) {
            return Err(LinkError::Timeout { waited: deadline });
        }
        self.received()
    }

    /// The answer that has come.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub fn received(mut self) -> Result<Answer, LinkError> {
        let (header, response, round_trip) = self.take()?;
        Ok(Answer { header, memory: self.hold(response), round_trip })
    }

    /// Holds the memory of an answer that was taken.
    pub fn hold(self, response: CheckedResponse) -> AnswerMemory {
        AnswerMemory { response, _pending: self.pending, _slot: self.slot }
    }
}
