//! Requests that get an error for an answer.

use pairmask_core::engine::{CullError, ReserveError};
use pairmask_wire::{Reject, StatusCode};

/// Why a request is not answered with what it asks for, as its client is told.
#[derive(Debug)]
pub(crate) struct Refusal {
    pub(super) status: StatusCode,
    /// What belongs to the status: sizes, an engine.
    pub(super) detail: [u64; 2],
    /// For the daemon's log.
    pub(super) text: String,
}

impl From<Reject> for Refusal {
    fn from(reject: Reject) -> Self {
        Self { status: reject.status(), detail: [0; 2], text: reject.to_string() }
    }
}

impl From<CullError> for Refusal {
    fn from(error: CullError) -> Self {
        let (status, detail) = match error {
            CullError::Reserve(ReserveError::TooLarge { at_least_bytes, limit_bytes }) => {
                (StatusCode::ReplyTooLarge, [at_least_bytes, limit_bytes])
            }
            CullError::Reserve(ReserveError::OutOfMemory { needed_bytes }) => {
                (StatusCode::OutOfMemory, [needed_bytes, 0])
            }
            CullError::Unavailable { engine, .. } => {
                (StatusCode::EngineUnavailable, [engine as u64, 0])
            }
            CullError::TooManyBoxes { n, limit, .. } => (StatusCode::TooManyBoxes, [n, limit]),
            CullError::DeviceLost { engine }
            | CullError::DeviceMemory { engine, .. }
            | CullError::TooCrowded { engine } => (StatusCode::EngineFailed, [engine as u64, 0]),
            // An error that this match does not know yet names no engine: 0 is none.
            _ => (StatusCode::EngineFailed, [0; 2]),
        };
        Self { status, detail, text: error.to_string() }
    }
}
