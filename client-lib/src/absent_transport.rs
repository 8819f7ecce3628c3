//! What sessions name of the transport in a build without the feature `daemon`.
//!
//! Errors and memory of the transport have no value here, so that the code of sessions is one.
#![allow(dead_code)] // A build without a transport needs the names only.

use pairmask_wire::Page;

/// Nothing has this type. What holds it privately is made by nobody, and still looks like any other
/// type to the code that names it.
#[derive(Clone, Copy, Debug)]
pub enum Never {}

/// No shared memory: never here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PopulateError {}

/// A step of the transport that failed: never here.
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
