//! Stands in for `link.rs` in a build without the feature `daemon`: there is no connection.
//!
//! These types have no value. The code of sessions is the same with a transport and without.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_wire::{ReplyError, RequestHeader, ResponseHeader};

use super::error::{ConnectError, Error};
use super::estimate::{Answered, Expected};
use super::kept_rules::KeptRules;
use super::settings::{Backend, Settings};
use crate::transport::{
    CheckedResponse, Never, OwnRequest, ResponseSample, SentRequest, TransportError,
};

/// A connection to one daemon process.
#[derive(Debug)]
pub(super) struct Link(Never);

/// One of the frames that a client may have at a time.
pub(super) struct Slot {
    link: Arc<Link>,
}

/// Shared memory for a request.
pub(super) struct SharedFrame {
    pub loan: OwnRequest,
    pub slot: Slot,
}

/// The result of waiting for a response.
pub(super) enum Received {
    Sample(ResponseSample),
    Nothing,
    Dead,
    Silent,
    Full,
}

/// Looks at a daemon.
#[derive(Default)]
pub(super) struct Vigil(());

/// A daemon that a session has left.
#[derive(Debug)]
pub(super) struct LeftDaemon(Never);

impl LeftDaemon {
    pub(super) const fn is_gone(&self) -> bool {
        match self.0 {}
    }

    pub(super) const fn has_run(&self) -> bool {
        match self.0 {}
    }
}

/// The error of a session that finds no daemon.
pub(super) const fn no_daemon(_: &Settings) -> ConnectError {
    ConnectError::NotBuiltIn
}

/// A frame that has no room for more.
pub(super) struct Ungrown {
    pub frame: Option<SharedFrame>,
    pub error: Error,
}

/// A request that could not be sent.
pub(super) enum Unsent {
    Undelivered { sent: SentRequest, slot: Slot, waited: Duration },
    Saved(SharedFrame),
    Lost(TransportError),
}

impl Slot {
    pub(super) const fn link(&self) -> &Arc<Link> {
        &self.link
    }
}

impl Link {
    /// The backend that a session uses for the one asked for: without a transport, frames are
    /// answered in process.
    pub(super) const fn backend(asked: Backend) -> Result<Backend, ConnectError> {
        match asked {
            Backend::Auto | Backend::InProcess => Ok(Backend::InProcess),
            Backend::Daemon => Err(ConnectError::NotBuiltIn),
        }
    }

    pub(super) const fn open(_: &Settings) -> Result<Self, ConnectError> {
        Err(ConnectError::NotBuiltIn)
    }

    pub(super) const fn token(&self) -> u64 {
        match self.0 {}
    }

    pub(super) const fn is_alive(&self) -> bool {
        match self.0 {}
    }

    pub(super) const fn has_answered(&self) -> bool {
        match self.0 {}
    }

    pub(super) const fn left(&self) -> LeftDaemon {
        match self.0 {}
    }

    pub(super) const fn kept_rules(&self) -> &KeptRules {
        match self.0 {}
    }

    pub(super) const fn say_refused(&self, _: &ReplyError) {
        match self.0 {}
    }

    pub(super) fn loan(self: &Arc<Self>, _: u64) -> Result<SharedFrame, Error> {
        match self.0 {}
    }

    pub(super) const fn check(
        &self,
        _: ResponseSample,
    ) -> Option<(ResponseHeader, CheckedResponse)> {
        match self.0 {}
    }

    pub(super) const fn note_frame(&self, _: Answered) {
        match self.0 {}
    }

    pub(super) const fn expect(&self, _: u32) -> Expected {
        match self.0 {}
    }

    pub(super) const fn receive(
        &self,
        _: &mut SentRequest,
        _: Instant,
        _: Expected,
        _: Duration,
        _: Instant,
        _: &mut Vigil,
    ) -> Result<Received, TransportError> {
        match self.0 {}
    }
}

impl SharedFrame {
    #[allow(clippy::needless_pass_by_value)] // As with a transport.
    pub(super) fn lend(slot: Slot, _: u64) -> Result<Self, Error> {
        match slot.link.0 {}
    }

    pub(super) fn grown(self, _: u64, _: u64) -> Result<Self, Ungrown> {
        match self.slot.link.0 {}
    }

    pub(super) fn send(self, _: &RequestHeader) -> Result<(SentRequest, Slot), Unsent> {
        match self.slot.link.0 {}
    }
}
