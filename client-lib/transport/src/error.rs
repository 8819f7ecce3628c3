//! Why a client cannot connect, and steps of the transport that fail.

use crate::process_limits::LimitError;

/// Why a client cannot connect.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// No daemon lets clients in.
    #[error("no daemon serves this instance")]
    NotServed,
    /// The daemon speaks another layout.
    #[error("the daemon speaks another layout")]
    Incompatible,
    /// The daemon has all the clients that it may have.
    #[error("the daemon already has all the clients that it may have")]
    TooManyClients,
    /// No shared memory.
    #[error("no shared memory for a segment: free space in /dev/shm or make it larger")]
    OutOfMemory,
    /// The daemon has no memory, or can open no more files.
    #[error("the daemon has no shared memory for a client, or can open no more files")]
    DaemonFull,
    /// The daemon does not answer.
    #[error("the daemon does not answer")]
    Silent,
    /// A limit of this process.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The transport failed in another way.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// A step of the transport that failed.
#[derive(Clone, Debug, thiserror::Error)]
#[error("transport: {step} failed ({detail})")]
pub struct TransportError {
    /// The step that was tried.
    pub step: &'static str,
    /// The transport's own error, as text.
    pub detail: String,
}

impl TransportError {
    /// An error of a step, with the transport's error.
    pub fn new(step: &'static str, detail: &impl std::fmt::Debug) -> Self {
        Self { step, detail: format!("{detail:?}") }
    }
}
