//! Why a request is refused.

use crate::status_code::StatusCode;
use crate::{REQUEST_MAGIC, Version};

/// Why a request is refused, before any box is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Reject {
    /// Not a pairmask request.
    #[error("the request's magic is {found:#010x}, not {REQUEST_MAGIC:#010x}")]
    Magic {
        /// What stood there.
        found: u32,
    },
    /// Another major version.
    #[error("the request speaks wire version {found}, this daemon {}", Version::CURRENT)]
    Version {
        /// The client's version.
        found: Version,
    },
    /// No such operation.
    #[error("unknown operation {found}")]
    Operation {
        /// What stood there.
        found: u32,
    },
    /// No such engine.
    #[error("unknown engine {found}")]
    Engine {
        /// What stood there.
        found: u32,
    },
    /// No such encoding.
    #[error("unknown encoding {found}")]
    Encoding {
        /// What stood there.
        found: u32,
    },
    /// A required section of a kind that this build does not know.
    #[error("unknown required section {found}")]
    UnknownSection {
        /// The kind.
        found: u32,
    },
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
    /// The rules of a frame say what cannot be.
    #[error("the {field} of a frame's rules is malformed")]
    Rules {
        /// The field.
        field: &'static str,
    },
    /// The rules that a frame names are not kept.
    #[error("the frame's rules are not kept: they are to be sent again")]
    UnknownRules,
    /// An edit of a scene says what cannot be.
    #[error("the edit's {field} is malformed")]
    Edit {
        /// The field.
        field: &'static str,
    },
    /// A query of a scene, or a frame of two sets, says what cannot be.
    #[error("the query's {field} is malformed")]
    Query {
        /// The field.
        field: &'static str,
    },
}

impl Reject {
    /// The status of the response.
    pub const fn status(&self) -> StatusCode {
        match self {
            Self::Version { .. } => StatusCode::VersionMismatch,
            Self::UnknownRules => StatusCode::UnknownRules,
            _ => StatusCode::BadRequest,
        }
    }
}
