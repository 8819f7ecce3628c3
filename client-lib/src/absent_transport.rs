//! What sessions name of the transport in a build without the feature `daemon`.
//!
//! Its types have no value: no error and no memory of the transport exists. The code of sessions is
//! the same with a transport and without.
#![allow(dead_code)] // A build without a transport needs the names only.

use pairmask_wire::Page;

/// A type without a value. A struct with a private field of it can be named and never made.
#[derive(Clone, Copy, Debug)]
pub enum Never {}

/// Missing shared memory: never made in this build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PopulateError {}

/// A limit of this process: never made in this build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LimitError {}

/// A step of the transport that failed: never made in this build.
#[derive(Clone, Debug, thiserror::Error)]
pub enum TransportError {}

/// Shared memory for a request.
pub struct OwnRequest(Never);

impl OwnRequest {
    /// Its pages.
    pub const fn pages(&self) -> &[Page] {
        match self.0 {}
    }

    /// Its pages, to be written.
    pub const fn pages_mut(&mut self) -> &mut [Page] {
        match self.0 {}
    }
}

/// A request under way.
pub struct SentRequest(Never);

impl SentRequest {
    /// Whether there was room for the request.
    pub const fn is_delivered(&self) -> bool {
        match self.0 {}
    }

    /// The pages of the request.
    pub const fn pages(&self) -> &[Page] {
        match self.0 {}
    }
}

/// A response in shared memory, as it came.
pub struct ResponseSample(Never);

/// A response in shared memory that was checked.
pub struct CheckedResponse(Never);

impl CheckedResponse {
    /// Its pages.
    pub const fn pages(&self) -> &[Page] {
        match self.0 {}
    }
}
