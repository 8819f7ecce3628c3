//! Stands in for `link.rs` and for the transport in a build without the feature `daemon`: there is no connection.
//!
//! These types have no value: no connection, no memory and no error of the transport exists. The code of sessions is
//! the same with a transport and without.
#![allow(dead_code, clippy::needless_pass_by_value)] // What is called with a transport.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::rhythm::{Answered, Expected};
use pairmask_wire::{Page, ReplyError, RequestHeader, ResponseHeader};

use super::error::{ConnectError, Error, Loss};
use super::kept_rules::KeptRules;
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
    OwnRequest {
        fn pages(&Self) -> &[Page];
        fn pages_mut(&mut Self) -> &mut [Page];
    }
    SentRequest {
        fn pages(&Self) -> &[Page];
    }
    ResponseSample {}
    CheckedResponse {
        fn pages(&Self) -> &[Page];
    }
    LeftDaemon {
        fn is_gone(&Self) -> bool;
        fn has_run(&Self) -> bool;
    }
    Slot {
        fn link(&Self) -> &Arc<Link>;
    }
    Unsent {
        fn pages(&Self) -> Option<&[Page]>;
        fn loss(&Self) -> Loss;
        fn into_error(Self) -> Error;
    }
    Link {
        fn token(&Self) -> u64;
        fn is_alive(&Self) -> bool;
        fn has_answered(&Self) -> bool;
        fn left(&Self) -> LeftDaemon;
        fn kept_rules(&Self) -> &KeptRules;
        fn say_refused(&Self, &ReplyError);
        fn check(&Self, ResponseSample) -> Option<(ResponseHeader, CheckedResponse)>;
        fn note_frame(&Self, Answered);
        fn expect(&Self, u32) -> Expected;
        fn receive(
            &Self, &mut SentRequest, Instant, Expected, Duration, Instant, &mut Vigil
        ) -> Result<Option<ResponseSample>, Error>;
    }
}

/// Looks at a daemon.
#[derive(Default)]
pub(super) struct Vigil(());

/// Shared memory for a request.
pub(super) struct SharedFrame {
    pub loan: OwnRequest,
    pub slot: Slot,
}

impl SharedFrame {
    pub(super) const fn lend(slot: Slot, _: u64) -> Result<Self, Error> {
        match slot.0 {}
    }

    pub(super) fn grown(self, _: u64, _: u64) -> Result<Self, (Error, Option<Self>)> {
        match self.slot.0 {}
    }

    pub(super) fn send(self, _: &RequestHeader) -> Result<(SentRequest, Slot), Unsent> {
        match self.slot.0 {}
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

    pub(super) fn loan(self: &Arc<Self>, _: u64) -> Result<SharedFrame, Error> {
        match self.0 {}
    }
}

/// The error of a session that finds no daemon.
pub(super) const fn no_daemon(_: &Settings) -> ConnectError {
    ConnectError::NotBuiltIn
}
