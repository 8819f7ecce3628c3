//! Status codes of responses, and the daemon's account of itself.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "transport")]
use iceoryx2::prelude::ZeroCopySend;

use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader};
use crate::section::{SectionKind, find};

/// How a request went.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum StatusCode {
    /// Answered.
    Ok = 0,
    /// The request cannot be understood.
    BadRequest = 1,
    /// Another major version of the wire contract.
    VersionMismatch = 2,
    /// More boxes than the engine takes. `detail` holds the boxes given and allowed.
    TooManyBoxes = 3,
    /// The mask does not fit. `detail` holds the bytes needed and allowed.
    ReplyTooLarge = 4,
    /// The daemon has no shared memory left. `detail` holds the bytes needed.
    OutOfMemory = 5,
    /// The engine asked for is not to be had here. `detail` holds its number.
    EngineUnavailable = 6,
    /// The engine failed in a way that no other code names.
    EngineFailed = 7,
}

impl StatusCode {
    /// Every code, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Ok,
        Self::BadRequest,
        Self::VersionMismatch,
        Self::TooManyBoxes,
        Self::ReplyTooLarge,
        Self::OutOfMemory,
        Self::EngineUnavailable,
        Self::EngineFailed,
    ];

    /// The code of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|c| *c as u32 == value)
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
        }
    }
}

/// Errors that the daemon remembers.
pub const LAST_ERRORS: usize = 8;

/// An error that the daemon gave to a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[cfg_attr(feature = "transport", derive(ZeroCopySend), type_name("pairmask.RecordedError"))]
pub struct RecordedError {
    /// Which client.
    pub client_token: u64,
    /// Which of its frames.
    pub frame: u64,
    /// Nanoseconds after the daemon's start.
    pub at_ns: u64,
    /// A [`StatusCode`].
    pub status: u32,
    /// Zero.
    pub reserved: u32,
}

/// What the daemon's auditor found when it checked frames again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[cfg_attr(feature = "transport", derive(ZeroCopySend), type_name("pairmask.AuditCounts"))]
pub struct AuditCounts {
    /// One frame in so many is checked; 0 for none.
    pub one_in: u64,
    /// Frames checked, wholly or in part.
    pub frames: u64,
    /// Frames drawn and not checked, since the auditor was still busy.
    pub skipped: u64,
    /// Pairs of boxes that were compared again.
    pub pairs: u64,
    /// Pairs among them that overlap and were not in the mask. Anything but 0 is a bug.
    pub missed: u64,
    /// Pairs among them that were in the mask and do not overlap. Anything but 0 is a bug.
    pub extra: u64,
}

/// The daemon's account of itself: the payload of a status response.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[cfg_attr(feature = "transport", derive(ZeroCopySend), type_name("pairmask.StatusBody"))]
pub struct StatusBody {
    /// Process that serves.
    pub pid: u32,
    /// Clients that have a connection.
    pub client_count: u32,
    /// Nanoseconds since the process began to serve.
    pub uptime_ns: u64,
    /// Frames answered with a mask.
    pub frames: u64,
    /// Boxes in those frames.
    pub boxes: u64,
    /// Pairs in those frames.
    pub pairs: u64,
    /// Requests answered with an error.
    pub errors: u64,
    /// The last errors, newest first; unused slots are zero.
    pub last_errors: [RecordedError; LAST_ERRORS],
    /// What the auditor found.
    pub audit: AuditCounts,
    /// Spheres in those frames (since 1.2; zero before).
    pub spheres: u64,
    /// Zero.
    pub reserved: u64,
}

impl StatusBody {
    /// Checks a response to a status request and reads its body.
    ///
    /// # Errors
    /// [`ReplyError`] where it is none.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload: &[u8],
    ) -> Result<Self, ReplyError> {
        let header = *header;
        Reply::check_envelope(&header, asked)?;
        let malformed = ReplyError::Malformed { field: "status body" };
        let section = find(&header.sections, SectionKind::Status).ok_or(malformed)?;
        if section.bytes != size_of::<Self>() as u64 || !section.fits(payload.len() as u64) {
            return Err(malformed);
        }
        let start = section.offset as usize;
        Ok(bytemuck::pod_read_unaligned(&payload[start..start + size_of::<Self>()]))
    }
}

const _: () = assert!(size_of::<AuditCounts>() == 48);
const _: () = assert!(size_of::<StatusBody>() == 48 + LAST_ERRORS * 32 + 64);
