//! Status codes of responses.

use bytemuck::CheckedBitPattern;

/// Outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, CheckedBitPattern)]
#[repr(u32)]
pub enum StatusCode {
    /// Answered.
    Ok = 0,
    /// The request is malformed.
    BadRequest = 1,
    /// Another major version of the wire contract.
    VersionMismatch = 2,
    /// More boxes than the engine takes. `detail` holds the boxes given and allowed.
    TooManyBoxes = 3,
    /// The mask does not fit. `detail` holds the bytes needed and allowed.
    ReplyTooLarge = 4,
    /// The daemon has no shared memory left. `detail` holds the bytes needed.
    OutOfMemory = 5,
    /// The engine asked for is not available. `detail` holds its number.
    EngineUnavailable = 6,
    /// The engine failed in a way that no other code names.
    EngineFailed = 7,
    /// The daemon does not have the scene as the edit expects it: the client sends it again whole.
    /// `detail` holds the revision that it has, 0 for none.
    StaleScene = 8,
    /// The client would have the daemon take more memory than it may. `detail` holds the bytes that it would take in
    /// all, and those that it may.
    OverBudget = 9,
    /// A shared scene has other terms than the member asks for. `detail` says which, and what holds.
    SharedDiffers = 10,
    /// A lease is refused. `detail` says why.
    LeaseRefused = 11,
    /// An edit of a shared scene names what its member has not leased. `detail` holds the index.
    NotLeased = 12,
    /// The daemon does not keep the rules that a frame names: the client sends them again.
    UnknownRules = 13,
}

impl StatusCode {
    /// The code of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        bytemuck::checked::try_cast(value).ok()
    }

    /// A short name for reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::BadRequest => "bad-request",
            Self::VersionMismatch => "version-mismatch",
            Self::TooManyBoxes => "too-many-boxes",
            Self::ReplyTooLarge => "reply-too-large",
            Self::OutOfMemory => "out-of-memory",
            Self::EngineUnavailable => "engine-unavailable",
            Self::EngineFailed => "engine-failed",
            Self::StaleScene => "stale-scene",
            Self::OverBudget => "over-budget",
            Self::SharedDiffers => "shared-differs",
            Self::LeaseRefused => "lease-refused",
            Self::NotLeased => "not-leased",
            Self::UnknownRules => "unknown-rules",
        }
    }

    /// What the numbers of an error say, to stand behind its name.
    pub(crate) fn explain(self, detail: [u64; 2]) -> String {
        let [needed, limit] = detail;
        match self {
            Self::OverBudget => format!(
                ": this client would take {} MiB of the daemon's memory and may take {} now, by `pairmaskd serve --max-memory`",
                needed.div_ceil(MIB),
                limit / MIB
            ),
            Self::EngineUnavailable if limit == ENGINE_IS_OPENING => {
                ": the daemon's GPU is being opened; ask again in a moment".into()
            }
            _ => String::new(),
        }
    }
}

const MIB: u64 = 1 << 20;

/// Second number of [`StatusCode::EngineUnavailable`] where the engine will be available soon: its device is being
/// opened. 0 where this daemon does not have the engine.
pub const ENGINE_IS_OPENING: u64 = 1;
