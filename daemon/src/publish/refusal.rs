//! Requests that get an error for an answer.

use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::shared::{LeaseError, NotLeased};
use pairmask_core::scene::{EditError, SceneError};
use pairmask_transport::OverBudget;
use pairmask_wire::{
    ENGINE_IS_OPENING, Reject, StatusCode, TermsDiffer, lease_detail, not_leased_detail,
};

/// Why a request is not answered with what it asks for, as its client reads it.
#[derive(Debug)]
pub(crate) struct Refusal {
    pub(super) status: StatusCode,
    /// What belongs to the status: sizes, an engine.
    pub(super) detail: [u64; 2],
    pub(super) text: String,
}

macro_rules! refuse {
    ($($error:ty: $name:ident => ($status:expr, $detail:expr);)+) => {
        $(impl From<$error> for Refusal {
            fn from($name: $error) -> Self {
                let (status, detail, text) = ($status, $detail, $name.to_string());
                Self { status, detail, text }
            }
        })+
    };
}

refuse! {
    Reject: error => (error.status(), [0; 2]);
    OverBudget: error => (StatusCode::OverBudget, [error.needed_bytes, error.limit_bytes]);
    TermsDiffer: error => (StatusCode::SharedDiffers, error.detail());
    LeaseError: error => (StatusCode::LeaseRefused, lease_detail(&error));
    NotLeased: error => (StatusCode::NotLeased, not_leased_detail(&error));
}

impl From<EditError> for Refusal {
    fn from(error: EditError) -> Self {
        let (status, detail) = match error {
            EditError::NoMemory { boxes } => (StatusCode::OutOfMemory, [boxes, 0]),
            _ => (StatusCode::BadRequest, [0; 2]),
        };
        Self { status, detail, text: error.to_string() }
    }
}

impl From<SceneError> for Refusal {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::Edit(error) => error.into(),
            SceneError::Cull(error) => error.into(),
            error => Self::engine_failed(&error),
        }
    }
}

impl Refusal {
    pub(crate) const fn status(&self) -> StatusCode {
        self.status
    }

    /// The scene is at this revision, and not at the one that an edit is for; 0 where there is none.
    pub(crate) fn stale_scene(revision: u64) -> Self {
        let text = format!("an edit of a scene that is at revision {revision}");
        Self { status: StatusCode::StaleScene, detail: [revision, 0], text }
    }

    /// An edit has no answer, for a reason that no status names.
    pub(crate) fn engine_failed(error: &SceneError) -> Self {
        Self { status: StatusCode::EngineFailed, detail: [0; 2], text: error.to_string() }
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
            CullError::Opening { engine } => {
                (StatusCode::EngineUnavailable, [engine as u64, ENGINE_IS_OPENING])
            }
            CullError::TooManyBoxes { n, limit, .. } => (StatusCode::TooManyBoxes, [n, limit]),
            CullError::DeviceLost { engine }
            | CullError::DeviceMemory { engine, .. }
            | CullError::TooCrowded { engine } => (StatusCode::EngineFailed, [engine as u64, 0]),
            // An error that this match does not know yet names no engine: 0 is none.
            _ => (StatusCode::EngineFailed, [0; 2]),
        };
        let text = match error {
            CullError::Reserve(ReserveError::OutOfMemory { needed_bytes }) => {
                format!(
                    "no shared memory for a mask of {needed_bytes} bytes: \
                     free space in /dev/shm or make it larger"
                )
            }
            error => error.to_string(),
        };
        Self { status, detail, text }
    }
}
