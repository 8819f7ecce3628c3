//! Why a request is not sent, or has no answer.

use std::time::Duration;

use pairmask_wire::ReplyError;

use crate::error::TransportError;
use crate::process_limits::LimitError;
use crate::room::PopulateError;

/// Why a request is not sent, or has no answer.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// All slots for frames are held.
    #[error("all slots for frames are held")]
    TooManyFrames,
    /// /dev/shm is full.
    #[error(transparent)]
    OutOfMemory(#[from] PopulateError),
    /// A limit of this process.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The transport gave no memory for the request.
    #[error(transparent)]
    NotSent(TransportError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The daemon died.
    #[error("the daemon died")]
    Died,
    /// There was no answer within this time.
    #[error("no answer within {waited:?}")]
    Timeout {
        /// How long it was waited for.
        waited: Duration,
    },
    /// The response is malformed.
    #[error(transparent)]
    Reply(#[from] ReplyError),
}
