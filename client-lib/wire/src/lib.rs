//! The wire contract: what lies in shared memory, byte by byte. `WIRE.md` draws it.
//!
//! A request and a response are each a fixed *header* (the transport's user header) and a *payload*
//! of whole pages. The header says by [`Section`]s what lies where in the payload. Everything is
//! little-endian. Each side treats the other's bytes as input from outside: it copies a header
//! once, validates the copy ([`Request::parse`], [`Reply::parse`]), and uses only the validated
//! form.

mod header;
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
pub use pages::{
    box_slice_in, boxes_in, boxes_in_mut, bytes_in_mut, objects_in, spheres_in, spheres_in_mut,
    words_in, words_in_mut,
};
pub use reject::Reject;
pub use reply::{Reply, ReplyError, ReplyFields, ResponseHeader, response_error, response_ok};
pub use request::{CullRequest, Request, ScenePlace};
pub use rules::{
    RulesLayout, RulesPlace, RulesReader, SentRules, TooManyPairs, WORLD_RANGE_WORDS,
    world_ranges_in, write_world_ranges,
};
pub use scene::{
    AgreedTerms, EditLayout, EditScratch, EndedPairs, JoinRequest, LONGEST_TICK, LeaseAction,
    LeaseRequest, QueryRequest, SceneAnswerLayout, SceneId, SceneName, SceneNameError, SceneReply,
    SceneRequest, SharedTerms, TermsDiffer, TickMarks, lease_detail, lease_error, not_leased,
    not_leased_detail, parse_joined, parse_leased, response_joined, response_leased,
    response_scene, response_scene_ended,
};
pub use section::{SECTION_COUNT, Section, SectionKind};
pub use status::{
    AuditCounts, LAST_ERRORS, RecordedError, SkipTotals, StatusBody, response_status,
};
pub use status_code::{ENGINE_IS_OPENING, StatusCode};

use pairmask_core::engine::EngineName;
use pairmask_core::mask::Encoding;
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::BoxForm;

/// Major version. A daemon answers only requests of its own. Raised when an old reader would
/// misread a message.
pub const VERSION_MAJOR: u16 = 1;
/// Minor version: that of the newest form of objects, encoding of masks, engine, operation, section or step
/// of an edit. Old readers may ignore what a minor version adds.
pub const VERSION_MINOR: u16 = newest_minor();
/// Minor version from which daemons know boxes in narrow forms.
pub const NARROW_BOXES_MINOR: u16 = 1;
/// Minor version from which daemons know spheres.
pub const SPHERES_MINOR: u16 = 2;

/// Minor version from which daemons keep scenes.
pub const SCENES_MINOR: u16 = 4;
/// Minor version from which whole frames have rules.
pub const FRAME_RULES_MINOR: u16 = 6;
/// Minor version from which scenes are queried, and frames are of two sets.
pub const QUERIES_MINOR: u16 = 7;
/// Minor version from which scenes are shared by several sessions.
pub const SHARED_MINOR: u16 = 8;
/// The minor version that added rules that a daemon keeps for the frames to come.
pub const KEPT_RULES_MINOR: u16 = 9;
/// Minor version from which a daemon decides the rules of scenes. Those from 5 on needed edits in which the client
/// had removed and set again each box whose rules changed.
pub const RULES_MINOR: u16 = 10;
/// Minor version from which shared scenes are queried, and report moved pairs.
pub const SHARED_QUERIES_MINOR: u16 = 11;

/// Minor version from which daemons know objects of a form.
pub const fn since_minor(form: ObjectForm) -> u16 {
    match form {
        ObjectForm::Boxes(BoxForm::F32) => 0,
        ObjectForm::Boxes(_) => NARROW_BOXES_MINOR,
        ObjectForm::Spheres => SPHERES_MINOR,
    }
}

/// The largest minor version that an operation, a section, a step of an edit, a form, an encoding or an engine needs.
const fn newest_minor() -> u16 {
    let (mut newest, mut i) = (SHARED_QUERIES_MINOR, 0);
    while i < ObjectForm::ALL.len() {
        newest = later(newest, since_minor(ObjectForm::ALL[i]));
        i += 1;
    }
    i = 0;
    while i < Encoding::ALL.len() {
        newest = later(newest, Encoding::ALL[i].since_minor());
        i += 1;
    }
    i = 0;
    while i < EngineName::ALL.len() {
        newest = later(newest, EngineName::ALL[i].descriptor().since_minor);
        i += 1;
    }
    newest
}

/// The larger of two minor versions.
const fn later(a: u16, b: u16) -> u16 {
    if a > b { a } else { b }
}

/// "PMRQ" in memory order. A wrong magic means that the writer is no pairmask client.
pub const REQUEST_MAGIC: u32 = u32::from_le_bytes(*b"PMRQ");
/// "PMRS" in memory order.
pub const RESPONSE_MAGIC: u32 = u32::from_le_bytes(*b"PMRS");

/// Version of the wire contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Must be equal on both sides.
    pub major: u16,
    /// May differ.
    pub minor: u16,
}

impl Version {
    /// The version that this build speaks.
    pub const CURRENT: Self = Self { major: VERSION_MAJOR, minor: VERSION_MINOR };
}

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}
