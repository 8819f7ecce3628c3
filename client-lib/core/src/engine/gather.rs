//! What the tasks of a frame gather words by: how many the reply holds, and which pairs count.

use super::word_budget::WordBudget;
use super::{AvailableIsa, PairRules};
use crate::mask::SparseMask;

/// What all tasks of a frame share.
#[derive(Clone, Copy)]
pub(crate) struct Gather<'a> {
    /// Words that may be kept.
    pub budget: &'a WordBudget,
    /// Pairs of boxes that do not pass are not kept.
    pub rules: PairRules<'a>,
    /// Box index at each position; empty where positions are indices.
    pub order: &'a [u32],
    /// What words are made and named with.
    pub isa: AvailableIsa,
    /// Whether words are kept, and not counted alone.
    pub keeps: bool,
}

impl Gather<'_> {
    /// Gives `take` the pairs of boxes that words name, some at a time, in the order of the words.
    pub fn name_pairs(&self, words: [&[u32]; 3], take: impl FnMut(&[[u32; 2]])) {
        let order = Some(self.order).filter(|order| !order.is_empty());
        SparseMask::of_found(self.budget.n(), words, order, self.isa).for_each_slice(take);
    }

    /// Keeps what passes the rules of some words, if there are any: those without bits go, and the
    /// others close up. Returns how many words stay at the front, and how many pairs went.
    pub fn sift(&self, words: [&mut [u32]; 3]) -> (usize, u64) {
        self.rules.sift(words, self.order, self.isa)
    }
}
