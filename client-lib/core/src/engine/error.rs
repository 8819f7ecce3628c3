//! Why an engine gives no answer.

use super::{EngineName, ReserveError};

/// Why an engine gave no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CullError {
    /// No memory for the mask.
    #[error(transparent)]
    Reserve(#[from] ReserveError),
    /// The engine is not available here.
    #[error("engine {engine} is not available: {why}")]
    Unavailable {
        /// The engine.
        engine: EngineName,
        /// What is missing.
        why: &'static str,
    },
    /// The engine is not available yet.
    #[error("engine {engine} is not available yet: its GPU is being opened; ask again in a moment")]
    Opening {
        /// The engine.
        engine: EngineName,
    },
    /// More boxes than the engine can take.
    #[error("{n} boxes are more than {engine} takes ({limit})")]
    TooManyBoxes {
        /// The engine.
        engine: EngineName,
        /// Boxes given.
        n: u64,
        /// Boxes allowed.
        limit: u64,
    },
    /// The scene is beyond what the engine was made for: too many boxes in one place. Another engine
    /// can serve it; this one stays usable.
    #[error("too many boxes in one place for {engine}: let another engine serve the scene")]
    TooCrowded {
        /// The engine.
        engine: EngineName,
    },
    /// Nobody waits for the answer any more. The engine stays usable.
    #[error("nobody waits for the answer any more")]
    Cancelled,
    /// The GPU is lost. Another engine can serve the same boxes; this one needs a new device.
    #[error("{engine} lost its GPU: let a CPU engine serve until the device is rebuilt")]
    DeviceLost {
        /// The engine.
        engine: EngineName,
    },
    /// The GPU has no memory for the scene. Another engine can serve it; this one stays usable.
    #[error("{engine} needs {needed_bytes} bytes of GPU memory that are not available")]
    DeviceMemory {
        /// The engine.
        engine: EngineName,
        /// Bytes of the block that was refused.
        needed_bytes: u64,
    },
}
