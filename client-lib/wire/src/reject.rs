//! Why a request is refused.

use crate::status_code::StatusCode;
use crate::{REQUEST_MAGIC, Version};

/// Why a request is refused, before any box is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Reject {
    /// Not a pairmask request, by this magic.
    #[error("the request's magic is {0:#010x}, not {REQUEST_MAGIC:#010x}")]
    Magic(u32),
    /// Another major version: the client's.
    #[error("the request speaks wire version {0}, this daemon {own}", own = Version::CURRENT)]
    Version(Version),
    /// No such operation.
    #[error("unknown operation {0}")]
    Operation(u32),
    /// No such engine.
    #[error("unknown engine {0}")]
    Engine(u32),
    /// No such encoding.
    #[error("unknown encoding {0}")]
    Encoding(u32),
    /// A required section of a kind that this build does not know.
    #[error("unknown required section {0}")]
    UnknownSection(u32),
    /// The section of boxes or spheres is missing, doubled (in the same form or in two), of the
    /// wrong length or outside of the payload.
    #[error(
        "the section of boxes or spheres does not hold {box_count} of them within {payload_bytes} bytes"
    )]
    Objects {
        /// Boxes or spheres announced.
        box_count: u32,
        /// Bytes of the payload.
        payload_bytes: u64,
    },
    /// A field of a frame's rules says what cannot be.
    #[error("the {0} of a frame's rules is malformed")]
    Rules(&'static str),
    /// The rules that a frame names are not kept.
    #[error("the frame's rules are not kept: they are to be sent again")]
    UnknownRules,
    /// A field of an edit of a scene says what cannot be.
    #[error("the edit's {0} is malformed")]
    Edit(&'static str),
    /// A field of a query of a scene, or of a frame of two sets, says what cannot be.
    #[error("the query's {0} is malformed")]
    Query(&'static str),
}

impl Reject {
    /// The status of the response.
    pub const fn status(&self) -> StatusCode {
        match self {
            Self::Version(_) => StatusCode::VersionMismatch,
            Self::UnknownRules => StatusCode::UnknownRules,
            _ => StatusCode::BadRequest,
        }
    }
}
