//! The wire contract: what lies in shared memory, byte by byte. `WIRE.md` draws it.
//!
//! A request and a response are each a fixed *header* (in an entry of a [board]) and a *payload*
//! of whole pages. The header says by [`Section`]s what lies where in the payload. Everything is
//! little-endian. Each side treats the other's bytes as input from outside: it copies a header
//! once, validates the copy ([`Request::parse`], [`Reply::parse`]), and uses only the validated
//! form.

pub mod board;
mod header;
mod mask;
mod name;
mod page;
mod pages;
mod reject;
mod reply;
mod request;
mod rules;
mod scene;
mod section;
mod status;
mod status_code;

pub use header::{Operation, RequestHeader};
pub use name::{InstanceError, InstanceName};
pub use page::{PAGE_BYTES, Page, page_count};
pub use pages::{bytes_in_mut, entries_in, entries_in_mut, words_in, words_in_mut};
pub use reject::Reject;
pub use reply::{Reply, ReplyError, ReplyFields, ResponseHeader, response_error, response_ok};
pub use request::{CullRequest, Request, SceneSections};
pub use rules::{
    CachedRules, RulesLayout, RulesNumber, RulesReader, RulesSections, SentRules, TooManyPairs,
    WORLD_RANGE_WORDS, world_ranges_in, write_world_ranges,
};
pub use scene::{
    AgreedTerms, CastReply, CastRequest, EditLayout, EditScratch, EndedPairs, JoinRequest,
    LONGEST_TICK, LeaseAction, LeaseRequest, ObserveReply, ObserveRequest, Observed, ObservedBox,
    QueryRequest, SceneAnswerLayout, SceneFile, SceneFileError, SceneId, SceneName, SceneNameError,
    SceneReply, SceneRequest, SharedTerms, TermsDiffer, TickMarks, TickNotes, lease_detail,
    lease_error, not_leased, not_leased_detail, parse_joined, parse_leased, response_cast,
    response_joined, response_leased, response_scene, response_scene_ended, write_scene,
};
pub use section::{SECTION_COUNT, Section, SectionKind};
pub use status::{
    AuditCounts, LAST_ERRORS, RecordedError, SkipTotals, StatusBody, response_status,
};
pub use status_code::{ENGINE_IS_OPENING, StatusCode};

/// Major version. A daemon answers only requests of its own. Raised when an old reader would
/// misread a message.
pub const VERSION_MAJOR: u16 = 1;
/// Minor version, raised when a form of objects, an encoding, an engine, an operation, a section or a step of an edit is
/// added. A client asks only a daemon of its own minor version or a later one.
pub const VERSION_MINOR: u16 = 15;
/// "PMRQ" in memory order. A wrong magic means that the writer is no pairmask client.
pub const REQUEST_MAGIC: u32 = u32::from_le_bytes(*b"PMRQ");
/// "PMRS" in memory order.
pub const RESPONSE_MAGIC: u32 = u32::from_le_bytes(*b"PMRS");

/// Version of the wire contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Must be equal on both sides.
    pub major: u16,
    /// That of a daemon is its client's or a later one.
    pub minor: u16,
}

impl Version {
    /// The version that this build speaks.
    pub const CURRENT: Self = Self { major: VERSION_MAJOR, minor: VERSION_MINOR };

    /// Whether a daemon of this version serves clients of this build.
    pub fn serves_this_build(self) -> bool {
        self.major == VERSION_MAJOR && self >= Self::CURRENT
    }
}

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}
