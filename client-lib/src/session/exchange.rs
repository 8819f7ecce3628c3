//! A request and its answer.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_wire::{Page, ReplyError, RequestHeader, ResponseHeader};

use super::error::{Error, Loss};
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
    #[allow(clippy::result_large_err)] // The error holds the request, which a frame goes on with.
    pub(super) fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, Unsent> {
        let at = Instant::now();
        let (pending, slot) = shared.send(header)?;
        Ok(Self { pending, slot, at, vigil: Vigil::default() })
    }

    /// Waits for the answer, as long as the deadline allows.
    ///
    /// # Errors
    /// [`Error`].
    pub(super) fn end(mut self, expected: Expected, settings: &Settings) -> Result<Answer, Error> {
        let deadline = Instant::now() + settings.deadline;
        let received = self.receive(expected, settings.spin, deadline)?;
        let sample = received.ok_or(Error::Timeout { waited: settings.deadline })?;
        let (header, response) = self.check(sample)?;
        Ok(self.answered(&header, response))
    }

    /// The answer if it comes until then, or why there will be none; else the exchange.
    #[allow(clippy::result_large_err)] // Its caller puts it back.
    pub(super) fn end_until(mut self, deadline: Instant) -> Result<Result<Answer, Error>, Self> {
        match self.receive(Expected::default(), Duration::ZERO, deadline) {
            Ok(Some(sample)) => Ok(match self.check(sample) {
                Ok((header, response)) => Ok(self.answered(&header, response)),
                Err(error) => Err(error.into()),
            }),
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

    pub(super) const fn link(&self) -> &Arc<Link> {
        self.slot.link()
    }

    /// When it was sent.
    pub(super) const fn at(&self) -> Instant {
        self.at
    }

    /// The pages of the request.
    pub(super) fn pages(&self) -> &[Page] {
        self.pending.pages()
    }

    /// Ends the request. Its place is free for another one.
    pub(super) fn into_slot(self) -> Slot {
        self.slot
    }

    /// Waits for the answer until then; `None` if it has not come.
    ///
    /// # Errors
    /// [`Error`]: there will be none.
    pub(super) fn receive(
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

    /// The header and the memory of an answer.
    pub(super) fn check(
        &self,
        sample: ResponseSample,
    ) -> Result<(ResponseHeader, CheckedResponse), ReplyError> {
        self.slot.link().check(sample).ok_or(ReplyError::Malformed { field: "place" })
    }

    /// The memory of an answer that was checked, for a mask that lies in it.
    pub(super) fn into_storage(self, response: CheckedResponse) -> Storage {
        let Self { pending, slot, .. } = self;
        Storage::Shared { response, _pending: pending, _slot: slot }
    }

    /// The answer, with what it has to hold.
    fn answered(self, header: &ResponseHeader, response: CheckedResponse) -> Answer {
        let Self { pending, slot, at, .. } = self;
        Answer { header: *header, response, sent_at: at, _pending: pending, _slot: slot }
    }
}

impl Unsent {
    /// The pages of the request, where they are kept.
    pub(super) fn pages(&self) -> Option<&[Page]> {
        match self {
            Self::Undelivered { sent, .. } => Some(sent.pages()),
            Self::Saved(shared) => Some(shared.loan.pages()),
            Self::Lost(_) => None,
        }
    }

    /// How the daemon was lost.
    pub(super) fn loss(&self) -> Loss {
        match self {
            Self::Undelivered { slot, .. } if slot.link().is_alive() => Loss::Silent,
            _ => Loss::Died,
        }
    }
}

impl From<Unsent> for Error {
    fn from(unsent: Unsent) -> Self {
        match (unsent.loss(), unsent) {
            (_, Unsent::Lost(error)) => error.into(),
            (Loss::Silent, Unsent::Undelivered { waited, .. }) => Self::Timeout { waited },
            _ => Self::DaemonDied,
        }
    }
}
