//! A contender of the comparison: it takes the boxes of a frame and visits every pair.

use pairmask_core::Aabb;

use super::tally::Tally;
use crate::oracle::Pair;

/// Why a contender failed on a frame.
#[derive(Debug, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct ContenderError {
    /// The contender.
    pub name: String,
    /// Its error.
    pub reason: String,
}

/// A library, set up in one way, on a number of threads.
///
/// A frame is `write`, then `find`, both on the threads that it was made for. The clock runs during
/// both, and `write` is shown by itself too.
pub trait Contender: Send {
    /// Writes the boxes to where a user of the contender would write them. Does nothing for a
    /// library that reads its user's boxes.
    ///
    /// # Errors
    /// [`ContenderError`].
    fn write(&mut self, boxes: &[Aabb]) -> Result<(), ContenderError> {
        let _ = boxes;
        Ok(())
    }

    /// Finds every pair of overlapping boxes and visits each once.
    ///
    /// # Errors
    /// [`ContenderError`].
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError>;

    /// The pairs of the last frame, in any order, each index and each pair in any order too. Not
    /// timed; the state afterwards is as before.
    ///
    /// # Errors
    /// [`ContenderError`].
    fn pairs(&mut self, boxes: &[Aabb]) -> Result<Vec<Pair>, ContenderError>;

    /// The engine that found the pairs of the last frame, where there is a choice.
    fn engine(&self) -> Option<String> {
        None
    }

    /// Rests until this contender's threads (a spinning daemon) disturb no other contender.
    fn settle(&self) {}
}
