//! Why an edit is refused, or has no answer.

use crate::engine::CullError;

/// Why an edit has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The edit is wrong. Nothing of it was applied.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The edit was applied, and the pairs of the whole scene could not be found. The next answer is a
    /// [resync](super::Reported::is_resync).
    #[error("the edit was applied and has no answer: {0}")]
    Cull(#[from] CullError),
}

/// What is wrong with an edit. Nothing of it was applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// An index beyond what the scene may hold.
    #[error("index {index} is beyond the {limit} boxes that this scene may hold")]
    BeyondLimit {
        /// The index.
        index: u64,
        /// Boxes that the scene may hold.
        limit: u32,
    },
    /// A step with more or fewer boxes, or filter data, than indices.
    #[error("{indices} indices are set to {boxes} boxes or filter data: give one for each")]
    Lengths {
        /// Indices of the step.
        indices: usize,
        /// Its boxes.
        boxes: usize,
    },
    /// A step with more or fewer margins than boxes.
    #[error("{boxes} boxes have {margins} margins: give one for each, or one for all")]
    Margins {
        /// Boxes of the step.
        boxes: usize,
        /// Their margins.
        margins: usize,
    },
    /// An index that is set twice.
    #[error("index {index} is set twice in one edit")]
    SetTwice {
        /// The index.
        index: u32,
    },
    /// An index without a box that is removed, enabled or disabled, given filter data or made static or not.
    #[error("index {index} has no box")]
    Absent {
        /// The index.
        index: u64,
    },
    /// A box with a margin in a scene whose boxes have none.
    #[error("this scene's boxes have no margins: give its options some")]
    NoMargins,
    /// A scene that cannot be moved, because f32 does not hold where one of its boxes would be.
    #[error("the scene cannot be moved: f32 does not hold where box {index} would be")]
    InexactShift {
        /// Its index.
        index: u32,
    },
    /// No memory for a scene of so many boxes.
    #[error("no memory for a scene of {boxes} boxes")]
    NoMemory {
        /// The boxes.
        boxes: u64,
    },
}
