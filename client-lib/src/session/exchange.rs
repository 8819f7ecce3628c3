//! A request and its answer, for requests that this process cannot answer from the memory that it sent.

use std::time::Instant;

use pairmask_wire::{ReplyError, RequestHeader, ResponseHeader};

use super::builder::Settings;
use super::error::WaitError;
use super::estimate::Expected;
use super::link::{Received, SharedFrame, Slot, Unsent};
use crate::transport::{CheckedResponse, SentRequest};

/// A request that was sent. Dropping it discards the answer.
pub(super) struct Exchange {
    pending: SentRequest,
    slot: Slot,
    at: Instant,
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

impl Exchange {
    /// Sends a request.
    ///
    /// # Errors
    /// [`WaitError::DaemonDied`], or [`WaitError::Timeout`] where the daemon receives nothing.
    pub(super) fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, WaitError> {
        let at = Instant::now();
        match shared.send(header) {
            Ok((pending, slot)) if pending.is_delivered() => Ok(Self { pending, slot, at }),
            Ok((_, slot)) if slot.link().is_alive() => {
                Err(WaitError::Timeout { waited: at.elapsed() })
            }
            Ok(_) | Err(Unsent::Saved(_)) => Err(WaitError::DaemonDied),
            Err(Unsent::Lost(error)) => Err(error.into()),
        }
    }

    /// Waits for the answer, as long as the deadline allows.
    ///
    /// # Errors
    /// [`WaitError`].
    pub(super) fn end(self, expected: Expected, settings: &Settings) -> Result<Answer, WaitError> {
        let Self { mut pending, slot, at } = self;
        let deadline = Instant::now() + settings.deadline;
        let link = slot.link();
        match link.receive(&mut pending, at, expected, settings.spin, deadline)? {
            Received::Sample(sample) => {
                let misplaced = ReplyError::Malformed { field: "place" };
                let (header, response) = link.check(sample).ok_or(misplaced)?;
                Ok(Answer { header, response, sent_at: at, _pending: pending, _slot: slot })
            }
            Received::Nothing => Err(WaitError::Timeout { waited: settings.deadline }),
            Received::Dead => Err(WaitError::DaemonDied),
        }
    }
}
