//! What edits of scenes are made of, and what answers tell.
//!
//! A client gives each box an index of its own, tells by an [edit](crate::SceneEdit) what changes, and [wants](Report)
//! to know which pairs began and ended, which there are around the boxes that moved, or all. A small edit costs what
//! it changes, not what the scene holds. [`pairmask_core::scene`] says how.

pub use pairmask_core::scene::shared;
pub use pairmask_core::scene::{
    EditError, EndReason, Ended, Indices, MarginedPairs, Margins, QueryError, Report, SceneError,
    SceneMargins, SceneOptions, SceneSkips, Sets, Step, Tags,
};
