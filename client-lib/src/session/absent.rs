//! Stands in for `link.rs` and for the transport in a build without the feature `daemon`: there is no connection.
//!
//! These types have no value: no connection, no memory and no error of the transport exists. The code of sessions is
//! the same with a transport and without.
#![allow(dead_code, clippy::needless_pass_by_value)] // What is called with a transport.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::pacing::{Answered, Expected};
use pairmask_wire::{CachedRules, Page, RequestHeader, ResponseHeader};

use super::error::{ConnectError, Error, Loss};
use super::settings::{Backend, Settings};

/// A type without a value. A struct with a private field of it can be named and never made.
#[derive(Clone, Copy, Debug)]
enum Never {}

/// Missing shared memory: never made in this build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PopulateError {}

/// A limit of this process: never made in this build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LimitError {}

/// A step of the transport that failed: never made in this build.
#[derive(Clone, Debug, thiserror::Error)]
pub enum TransportError {}

/// A connection's error: never made in this build.
#[derive(Debug)]
pub(super) enum LinkError {
    TooManyFrames,
}

/// Types without a value, and what is called of them.
macro_rules! never {
    ($($type:ident { $(fn $method:ident($self:ty $(, $argument:ty)*) $(-> $result:ty)?;)* })*) => {$(
        #[derive(Debug)]
        pub(super) struct $type(Never);

        impl $type {
            $(pub(super) const fn $method(self: $self $(, _: $argument)*) $(-> $result)? {
                match self.0 {}
            })*
        }
    )*};
}

never! {
    Chunk {
        fn pages(&Self) -> &[Page];
        fn pages_mut(&mut Self) -> &mut [Page];
    }
    CheckedResponse {
        fn pages(&Self) -> &[Page];
    }
    AnswerMemory {
        fn pages(&Self) -> &[Page];
    }
    LeftDaemon {
        fn has_ended(&Self) -> bool;
        fn has_run(&Self) -> bool;
    }
    Slot {
        fn link(&Self) -> &Arc<Link>;
    }
    Unsent {
        fn pages(&Self) -> &[Page];
    }
    Exchange {
        fn link(&Self) -> &Arc<Link>;
        fn pages(&Self) -> &[Page];
        fn into_slot(Self) -> Slot;
        fn has_come(&mut Self, Expected, Duration, Instant) -> bool;
        fn has_come_by(&mut Self, Instant) -> bool;
        fn is_answered(&Self) -> bool;
        fn take(&mut Self) -> Result<(ResponseHeader, CheckedResponse, Duration), LinkError>;
        fn end(Self, Expected, Duration, Duration) -> Result<Answer, LinkError>;
        fn received(Self) -> Result<Answer, LinkError>;
        fn hold(Self, CheckedResponse) -> AnswerMemory;
    }
    Link {
        fn token(&Self) -> u64;
        fn is_alive(&Self) -> bool;
        fn has_answered(&Self) -> bool;
        fn left(&Self) -> LeftDaemon;
        fn cached_rules(&Self) -> &CachedRules;
        fn refuse(&Self) -> bool;
        fn note_frame(&Self, Answered);
        fn expect(&Self, u32) -> Expected;
    }
}

/// The answer to a request.
pub(super) struct Answer {
    pub header: ResponseHeader,
    pub memory: AnswerMemory,
    pub round_trip: Duration,
}

/// Shared memory for a request.
pub(super) struct SharedFrame {
    pub loan: Chunk,
    pub slot: Slot,
}

impl SharedFrame {
    pub(super) const fn lend(slot: Slot, _: u64) -> Result<Self, LinkError> {
        match slot.0 {}
    }

    pub(super) fn enlarged(self, _: u64, _: u64) -> Result<Self, (LinkError, Self)> {
        match self.slot.0 {}
    }
}

impl Exchange {
    pub(super) fn begin(shared: SharedFrame, _: &RequestHeader) -> Result<Self, Unsent> {
        match shared.slot.0 {}
    }
}

impl Link {
    pub(super) fn loan(self: &Arc<Self>, _: u64) -> Result<SharedFrame, LinkError> {
        match self.0 {}
    }
}

/// The backend that a session uses for the one asked for: without a transport, frames are answered in process.
pub(super) const fn backend(asked: Backend) -> Result<Backend, ConnectError> {
    match asked {
        Backend::Auto | Backend::InProcess => Ok(Backend::InProcess),
        Backend::Daemon => Err(ConnectError::NotBuiltIn),
    }
}

pub(super) const fn open(_: &Settings) -> Result<Link, ConnectError> {
    Err(ConnectError::NotBuiltIn)
}

/// The error of a session that finds no daemon.
pub(super) const fn no_daemon(_: &Settings) -> ConnectError {
    ConnectError::NotBuiltIn
}

impl From<LinkError> for Error {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::TooManyFrames => Self::TooManyFrames,
        }
    }
}

impl From<Unsent> for Error {
    fn from(unsent: Unsent) -> Self {
        match unsent.0 {}
    }
}

pub(super) const fn loss_of(unsent: &Unsent) -> Loss {
    match unsent.0 {}
}
