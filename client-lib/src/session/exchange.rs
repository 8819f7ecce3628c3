//! A request and its answer, for requests that this process cannot answer from the memory that it sent.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_wire::{ReplyError, RequestHeader, ResponseHeader};

use super::error::Error;
use super::estimate::Expected;
use super::link::{Link, Received, SharedFrame, Slot, Unsent, Vigil};
use super::pairs::Storage;
use super::settings::Settings;
use crate::transport::{CheckedResponse, ResponseSample, SentRequest};

/// A request that was sent. Dropping it discards the answer.
pub(super) struct Exchange {
    pending: SentRequest,
    slot: Slot,
    at: Instant,
    vigil: Vigil,
}

/// The answer to a request. Its memory is held until it is dropped.
pub(super) struct Answer {
    /// A copy, not validated yet.
    pub header: ResponseHeader,
    pub response: CheckedResponse,
    /// When the request was sent.
    pub sent_at: Instant,
    _pending: SentRequest,
    _slot: Slot,
}

impl Answer {
    /// Its memory, for a mask that lies in it.
    pub(super) fn into_storage(self) -> Storage {
        let Self { response, _pending: pending, _slot: slot, .. } = self;
        Storage::Shared { response, _pending: pending, _slot: slot }
    }
}

impl Exchange {
    /// Sends a request.
    ///
    /// # Errors
    /// [`Error::DaemonDied`], or [`Error::Timeout`] where the daemon receives nothing.
    pub(super) fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, Error> {
        let at = Instant::now();
        match shared.send(header) {
            Ok((pending, slot)) if pending.is_delivered() => {
                Ok(Self { pending, slot, at, vigil: Vigil::default() })
            }
            Ok((_, slot)) if slot.link().is_alive() => Err(Error::Timeout { waited: at.elapsed() }),
            Ok(_) | Err(Unsent::Saved(_)) => Err(Error::DaemonDied),
            Err(Unsent::Lost(error)) => Err(error.into()),
        }
    }

    /// Waits for the answer, as long as the deadline allows.
    ///
    /// # Errors
    /// [`Error`].
    pub(super) fn end(mut self, expected: Expected, settings: &Settings) -> Result<Answer, Error> {
        let deadline = Instant::now() + settings.deadline;
        let received = self.receive(expected, settings.spin, deadline)?;
        self.accept(received.ok_or(Error::Timeout { waited: settings.deadline })?)
    }

    /// The answer if it comes until then, or why there will be none; else the exchange.
    #[allow(clippy::result_large_err)] // Its caller puts it back.
    pub(super) fn end_until(mut self, deadline: Instant) -> Result<Result<Answer, Error>, Self> {
        match self.receive(Expected::default(), Duration::ZERO, deadline) {
            Ok(Some(sample)) => Ok(self.accept(sample)),
            Ok(None) => Err(self),
            Err(error) => Ok(Err(error)),
        }
    }

    /// Whether the daemon has answered, for whom the answer does not matter.
    ///
    /// # Errors
    /// [`Error`].
    pub(super) fn is_answered(&mut self) -> Result<bool, Error> {
        let now = Instant::now();
        Ok(self.receive(Expected::default(), Duration::ZERO, now)?.is_some())
    }

    /// Whether it is one of this connection.
    pub(super) fn is_on(&self, link: &Arc<Link>) -> bool {
        Arc::ptr_eq(self.slot.link(), link)
    }

    fn receive(
        &mut self,
        expected: Expected,
        spin: Duration,
        deadline: Instant,
    ) -> Result<Option<ResponseSample>, Error> {
        let Self { pending, slot, at, vigil } = self;
        match slot.link().receive(pending, *at, expected, spin, deadline, vigil)? {
            Received::Sample(sample) => Ok(Some(sample)),
            Received::Nothing => Ok(None),
            Received::Dead => Err(Error::DaemonDied),
            Received::Silent => Err(Error::Timeout { waited: at.elapsed() }),
            Received::Full => Err(Error::DaemonFull),
        }
    }

    fn accept(self, sample: ResponseSample) -> Result<Answer, Error> {
        let Self { pending, slot, at, .. } = self;
        let misplaced = ReplyError::Malformed { field: "place" };
        let (header, response) = slot.link().check(sample).ok_or(misplaced)?;
        Ok(Answer { header, response, sent_at: at, _pending: pending, _slot: slot })
    }
}
