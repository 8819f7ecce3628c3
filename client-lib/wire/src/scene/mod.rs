//! Scenes that persist: edits that a client sends, and what the daemon tells.
//!
//! ```text
//! request   the header of an edit
//! body      its steps, which lie in the payload
//! answer    the header and the payload of what is told
//! ```

mod answer;
mod body;
mod request;

pub use answer::{EndedPairs, SceneAnswerLayout, SceneReply, response_scene, response_scene_ended};
pub use body::{EditLayout, EditScratch};
pub use request::{SceneId, SceneRequest};
