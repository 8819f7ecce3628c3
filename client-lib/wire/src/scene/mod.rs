//! Scenes that persist: edits that a client sends, and what the daemon tells.
//!
//! ```text
//! request   the header of an edit
//! body      its steps, which lie in the payload
//! query     boxes that are asked of a scene
//! answer    the header and the payload of what is told
//! ```

mod answer;
mod body;
mod query;
mod request;

pub use answer::{EndedPairs, SceneAnswerLayout, SceneReply, response_scene, response_scene_ended};
pub use body::{EditLayout, EditScratch};
pub use query::QueryRequest;
pub use request::{SceneId, SceneRequest};
