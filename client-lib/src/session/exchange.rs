//! A request and its answer.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::rhythm::Expected;
use pairmask_wire::{Page, ReplyError, RequestHeader, ResponseHeader};

use super::error::Error;
use super::link::{Link, SharedFrame, Slot, Unsent};
use super::settings::Settings;
use crate::transport::{CheckedResponse, ResponseSample, SentRequest, Vigil};

/// A request that was sent. Dropping it discards the answer.
pub(super) struct Exchange {
    pending: SentRequest,
    slot: Slot,
    at: Instant,
    vigil: Vigil,
    /// The answer, as it came after this time, or why there will be none.
    came: Option<Result<(ResponseSample, Duration), Error>>,
}

/// The answer to a request. Its memory is held until it is dropped.
pub(super) struct Answer {
    /// A copy, not validated yet.
    pub header: ResponseHeader,
    pub memory: AnswerMemory,
    /// From the request to the answer.
    pub round_trip: Duration,
}

/// The memory of an answer. It keeps its request's channel: the transport would give a free channel to the next
/// request, whose response could then not be borrowed beside this one.
pub(super) struct AnswerMemory {
    response: CheckedResponse,
    _pending: SentRequest,
    _slot: Slot,
}

impl AnswerMemory {
    pub(super) fn pages(&self) -> &[Page] {
        self.response.pages()
    }
}

impl Exchange {
    /// Sends a request.
    #[allow(clippy::result_large_err)] // The error holds the request, which a frame goes on with.
    pub(super) fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, Unsent> {
        let at = Instant::now();
        let (pending, slot) = shared.send(header)?;
        Ok(Self { pending, slot, at, vigil: Vigil::default(), came: None })
    }

    pub(super) const fn link(&self) -> &Arc<Link> {
        self.slot.link()
    }

    /// The pages of the request.
    pub(super) fn pages(&self) -> &[Page] {
        self.pending.pages()
    }

    /// Ends the request. Its place is free for another one.
    pub(super) fn into_slot(self) -> Slot {
        self.slot
    }

    /// Waits until then for the answer, or for what says that there will be none. Whether either has come.
    pub(super) fn has_come(&mut self, expected: Expected, spin: Duration, until: Instant) -> bool {
        if self.came.is_none() {
            let Self { pending, slot, at, vigil, .. } = self;
            let received = slot.link().receive(pending, *at, expected, spin, until, vigil);
            let came = |received: Result<ResponseSample, Error>| {
                received.map(|sample| (sample, at.elapsed()))
            };
            self.came = received.transpose().map(came);
        }
        self.came.is_some()
    }

    /// As [`has_come`](Self::has_come), for whom the answer does not matter yet.
    pub(super) fn has_come_by(&mut self, until: Instant) -> bool {
        self.has_come(Expected::default(), Duration::ZERO, until)
    }

    /// Whether what has come is an answer.
    pub(super) const fn is_answered(&self) -> bool {
        matches!(self.came, Some(Ok(_)))
    }

    /// Takes the answer that has come: a copy of its header, its memory, and the time since the request.
    ///
    /// # Errors
    /// [`Error`]; a [`Timeout`](Error::Timeout) where nothing has come.
    pub(super) fn take(&mut self) -> Result<(ResponseHeader, CheckedResponse, Duration), Error> {
        let timeout = || Err(Error::Timeout { waited: self.at.elapsed() });
        let (sample, round_trip) = self.came.take().unwrap_or_else(timeout)?;
        let checked = self.slot.link().check(sample);
        let (header, response) = checked.ok_or(ReplyError::Malformed { field: "place" })?;
        Ok((header, response, round_trip))
    }

    /// Waits for the answer, as long as the deadline allows.
    ///
    /// # Errors
    /// [`Error`].
    pub(super) fn end(mut self, expected: Expected, settings: &Settings) -> Result<Answer, Error> {
        let deadline = Instant::now() + settings.deadline;
        if !self.has_come(expected, settings.spin, deadline) {
            return Err(Error::Timeout { waited: settings.deadline });
        }
        self.received()
    }

    /// The answer that has come.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub(super) fn received(mut self) -> Result<Answer, Error> {
        let (header, response, round_trip) = self.take()?;
        Ok(Answer { header, memory: self.hold(response), round_trip })
    }

    /// Holds the memory of an answer that was taken.
    pub(super) fn hold(self, response: CheckedResponse) -> AnswerMemory {
        AnswerMemory { response, _pending: self.pending, _slot: self.slot }
    }
}

impl From<Unsent> for Error {
    fn from(unsent: Unsent) -> Self {
        unsent.into_error()
    }
}
