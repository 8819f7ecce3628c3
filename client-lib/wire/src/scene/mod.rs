//! Persistent scenes: edits that a client sends, and what the daemon reports.
//!
//! ```text
//! request   the header of an edit
//! body      its steps, which lie in the payload
//! query     boxes that are asked of a scene
//! cast      rays and spheres that are cast into it
//! questions what both have in their payload
//! observe   which boxes of a shared scene changed
//! answer    the header and the payload of what is reported
//! shared    scenes that several sessions write
//! tick      what a tick of theirs says beside pairs
//! file      scenes that are saved
//! ```

mod answer;
mod body;
mod cast;
mod file;
mod observe;
mod query;
mod questions;
mod request;
mod shared;
mod tick;

pub use answer::{EndedPairs, SceneAnswerLayout, SceneReply, response_scene, response_scene_ended};
pub use body::{EditLayout, EditScratch};
pub use cast::{CastReply, CastRequest, response_cast};
pub use file::{SceneFile, SceneFileError, write_scene};
pub use observe::{ObserveReply, ObserveRequest, Observed, ObservedBox};
pub use query::QueryRequest;
pub use request::{SceneId, SceneRequest};
pub use shared::{
    AgreedTerms, JoinRequest, LONGEST_TICK, LeaseAction, LeaseRequest, SceneName, SceneNameError,
    SharedTerms, TermsDiffer, lease_detail, lease_error, not_leased, not_leased_detail,
    parse_joined, parse_leased, response_joined, response_leased,
};
pub use tick::{TickMarks, TickNotes};
