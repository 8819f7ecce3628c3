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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{HeapReply, PairTest};
    use crate::mask::Encoding;
    use crate::units::BoxCount;

    struct EvenColumns;

    impl PairTest for EvenColumns {
        fn passing(&self, _: u32, _: u32, bits: u32, _: &[u32]) -> u32 {
            bits & 0x5555_5555
        }
    }

    #[test]
    fn words_without_a_passing_pair_go_and_the_others_close_up() {
        let reply = HeapReply::new();
        let budget = WordBudget::new(BoxCount::new(70), Encoding::Sparse, false, &reply);
        let budget = budget.expect("no limit");
        let sift = |test: Option<&dyn PairTest>| {
            let mut words = [[0, 1, 2], [1, 1, 2], [0b11, 0b10, 0b111]];
            let [rows, blocks, bits] = &mut words;
            let gather = Gather {
                budget: &budget,
                rules: test.map_or(PairRules::NONE, PairRules::tested_by),
                order: &[],
                isa: AvailableIsa::best(),
            };
            let (kept, gone) = gather.sift([rows, blocks, bits]);
            (words.map(|array| array[..kept].to_vec()), gone)
        };
        assert_eq!(sift(None), ([vec![0, 1, 2], vec![1, 1, 2], vec![3, 2, 7]], 0));
        assert_eq!(sift(Some(&EvenColumns)), ([vec![0, 2], vec![1, 2], vec![1, 5]], 3));
    }
}
