//! A contender of the comparison: it takes the boxes of a frame and iterates over every pair.

use pairmask_core::Aabb;

use crate::oracle::Pair;

/// What is done with the pairs, equal in every timed frame of every contender, the least that needs both indices: their
/// number, and a sum that depends on each pair but not on the order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub count: u64,
    /// Sum of a ^ b, less than 1 ns a pair. Different sets may have the same sum; a comparison of sets, pair by pair,
    /// is done apart.
    pub sum: u64,
}

impl Tally {
    #[inline(always)]
    pub fn iterate(&mut self, a: u32, b: u32) {
        self.count += 1;
        self.sum += u64::from(a ^ b);
    }

    #[must_use]
    pub const fn plus(self, other: Self) -> Self {
        Self { count: self.count + other.count, sum: self.sum + other.sum }
    }
}

/// Pairs, each with its lower index first, sorted: as the oracle has them.
pub fn sorted(mut pairs: Vec<Pair>) -> Vec<Pair> {
    for pair in &mut pairs {
        *pair = [pair[0].min(pair[1]), pair[0].max(pair[1])];
    }
    pairs.sort_unstable();
    pairs
}

/// Whether closed boxes overlap, compared as floats: what a user of the others would write.
pub fn touches(p: &Aabb, q: &Aabb) -> bool {
    (0..3).all(|axis| p.min[axis] <= q.max[axis] && q.min[axis] <= p.max[axis])
}

#[derive(Debug, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct ContenderError {
    pub name: String,
    pub reason: String,
}

/// Takes the first of a pair out of the list of its second.
pub fn remove(name: &str, partners: &mut Vec<u32>, [a, of]: Pair) -> Result<(), ContenderError> {
    let slot = partners.iter().position(|&other| other == a).ok_or_else(|| ContenderError {
        name: name.to_owned(),
        reason: format!("the pair of {a} and {of} ended and never began"),
    })?;
    partners.swap_remove(slot);
    Ok(())
}

/// A library, set up in one way, on a number of threads.
///
/// A frame is `write`, then `find`, both on the threads that it was made for. The clock runs during
/// both, and `write` is shown by itself too.
pub trait Contender: Send {
    /// Writes the boxes to where a user of the contender would write them. Does nothing for a
    /// library that reads its user's boxes.
    fn write(&mut self, boxes: &[Aabb]) -> Result<(), ContenderError> {
        let _ = boxes;
        Ok(())
    }

    /// Finds every pair of overlapping boxes and iterates over each once.
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError>;

    /// The pairs of the last frame, in any order, each index and each pair in any order too. Not
    /// timed; the state afterwards is as before.
    fn pairs(&mut self, boxes: &[Aabb]) -> Result<Vec<Pair>, ContenderError>;

    /// The engine that found the pairs of the last frame, where there is a choice.
    fn engine(&self) -> Option<String> {
        None
    }

    /// Rests until this contender's threads (a spinning daemon) disturb no other contender.
    fn settle(&self) {}
}
