//! Batches of searches under way: each is a step behind the one after it.

use super::{Candidate, Cells, INDEX, Searches};

/// Boxes that are looked around at a time.
pub(in crate::scene) const BATCH: usize = 16;
/// Batches that are under way at a time.
pub(in crate::scene) const BATCHES: usize = 4;

/// Tests of boxes in cells that take as long as to compare a candidate that is not sure, exactly.
const CANDIDATE_TESTS: i64 = 16;

/// The searches of a batch, and what they found.
#[derive(Debug, Default)]
pub(in crate::scene) struct Looked {
    pub searches: Searches,
    pub candidates: Vec<Candidate>,
}

impl Looked {
    /// Finds the candidates among boxes with indices below `end`, and asks for those that are not sure. Returns how many
    /// boxes were tested.
    pub fn finish(&mut self, cells: &Cells, end: usize, ask_for: impl Fn(u32)) -> u64 {
        let Self { searches, candidates } = self;
        candidates.clear();
        let tested = cells.finish(searches, candidates);
        // A slot may be that of an index that is no more: its box was removed at the end.
        candidates.retain(|candidate| ((candidate.word & INDEX) as usize) < end);
        candidates.iter().filter(|this| !this.is_sure).for_each(|this| ask_for(this.word));
        tested
    }

    /// What comparing the candidates takes, in tests.
    pub fn candidate_tests(&self) -> i64 {
        let unsure = self.candidates.iter().filter(|candidate| !candidate.is_sure);
        CANDIDATE_TESTS * unsure.count() as i64
    }
}

/// Takes `count` batches through their stages, of which there are [`BATCHES`], while `stage` says that there is more to
/// do. It is given the stage, the number of the batch, and its memory.
#[inline]
pub(in crate::scene) fn in_stages<B>(
    batches: &mut [B; BATCHES],
    count: usize,
    mut stage: impl FnMut(usize, usize, &mut B) -> bool,
) {
    for step in 0..count + BATCHES - 1 {
        // The latest batch first: what it asks for has the time of all others to come.
        for number in 0..BATCHES {
            let batch = step.checked_sub(number).filter(|batch| *batch < count);
            if batch.is_some_and(|batch| !stage(number, batch, &mut batches[batch % BATCHES])) {
                return;
            }
        }
    }
}
