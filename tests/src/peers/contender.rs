//! What is compared: something that takes the boxes of a frame and visits every pair.

use pairmask::Aabb;

use super::tally::Tally;
use crate::oracle::Pair;

/// Why a contender has no pairs for a frame.
#[derive(Debug, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct ContenderError {
    /// Who.
    pub name: String,
    /// What it said.
    pub reason: String,
}

/// A library, set up in one way, on a number of threads.
///
/// A frame is `write`, then `find`, both on the threads that it was made for. The clock runs
/// during `find`, and by itself during `write`.
pub trait Contender: Send {
    /// Puts the boxes where the contender's user would have written them in the first place.
    /// Nothing for a library that reads the boxes of its user.
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

    /// Which engine found the pairs of the last frame, where there is a choice.
    fn engine(&self) -> Option<String> {
        None
    }

    /// Rests until what this contender left running (a spinning daemon) disturbs nobody.
    fn settle(&self) {}
}
