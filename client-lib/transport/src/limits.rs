//! What both sides agree on.

/// Limits of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at a time. Each costs the daemon some descriptors and a few kilobytes.
    pub max_clients: usize,
    /// Bytes of the largest mask.
    pub max_reply_bytes: u64,
    /// Bytes that the daemon may take for its clients, and for itself.
    pub max_memory_bytes: u64,
}

impl Default for Limits {
    /// 100 clients; masks of 1 GiB: the dense mask of 131,000 boxes, or 80 million sparse words; memory of 8 GiB, half
    /// of it for one client: a scene of 14 million boxes.
    fn default() -> Self {
        Self { max_clients: 100, max_reply_bytes: 1 << 30, max_memory_bytes: 8 << 30 }
    }
}

/// Frames that a client may have at a time, in any mix of being filled, under way, and held as
/// masks: two under way overlap upload, computation and download; the third is filled meanwhile.
pub const FRAMES_AT_A_TIME: usize = 3;

/// Limits the transport's log to the level in `IOX2_LOG_LEVEL`: a failed attempt to connect is an
/// everyday event here, and a typed error.
pub fn quiet_transport_log() {
    iceoryx2::prelude::set_log_level_from_env_or(iceoryx2::prelude::LogLevel::Fatal);
}
