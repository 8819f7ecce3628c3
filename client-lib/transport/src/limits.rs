//! What both sides agree on: limits, and what can go wrong.

use std::time::Duration;

use crate::process_limits::LimitError;

/// Limits of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at a time. Each costs the daemon some descriptors and a few kilobytes.
    pub max_clients: usize,
    /// Bytes of the largest mask.
    pub max_reply_bytes: u64,
    /// Bytes that all scenes together may take.
    pub max_scene_bytes: u64,
}

impl Default for Limits {
    /// 100 clients; masks of 1 GiB: the dense mask of 131,000 boxes, or 80 million sparse words; scenes of
    /// 4 GiB: 14 million boxes.
    fn default() -> Self {
        Self { max_clients: 100, max_reply_bytes: 1 << 30, max_scene_bytes: 4 << 30 }
    }
}

/// Frames that a client may have at a time, in any mix of being filled, under way, and held as
/// masks: two under way overlap upload, computation and download; the third is filled meanwhile.
pub const FRAMES_AT_A_TIME: usize = 3;

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

/// Limits the transport's log to the level in `IOX2_LOG_LEVEL`: a failed attempt to connect is an
/// everyday event here, and a typed error.
pub fn quiet_transport_log() {
    iceoryx2::prelude::set_log_level_from_env_or(iceoryx2::prelude::LogLevel::Fatal);
}

/// Time between two looks at what clients left: a dead client's memory is free again within a second.
pub const JANITOR_INTERVAL: Duration = Duration::from_millis(500);
