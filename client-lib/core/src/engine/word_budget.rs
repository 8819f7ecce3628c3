//! How many words, or pairs, a frame may find: what the reply holds, shared by all of the frame's
//! tasks.

use std::sync::atomic::{AtomicU64, Ordering};

use super::{ReplyBuffer, ReserveError};
use crate::mask::{Encoding, MaskShape};
use crate::units::BoxCount;

const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// The words that the tasks of a frame may still keep; for a list, the pairs.
///
/// Tasks take words in lots (a full chunk, the words of some rows), so that counting costs nothing
/// beside finding them. A search therefore ends a lot a task after the first word beyond. What is
/// below the budget is held to the limit exactly when the reply is reserved.
pub(crate) struct WordBudget {
    taken: AtomicU64,
    most: u64,
    n: BoxCount,
    encoding: Encoding,
    with_order: bool,
    limit_words: u64,
}

impl WordBudget {
    /// The budget of a mask of `n` boxes in memory of `reply`. The engine has an order of its own or
    /// keeps that of the boxes.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`] where the reply has no room whatever the boxes are.
    pub fn new(
        n: BoxCount,
        encoding: Encoding,
        with_order: bool,
        reply: &dyn ReplyBuffer,
    ) -> Result<Self, ReserveError> {
        let limit_words = reply.limit_words();
        let most = MaskShape::words_within(encoding, n, limit_words, with_order);
        let taken = AtomicU64::new(0);
        let budget = Self { taken, most: most.unwrap_or(0), n, encoding, with_order, limit_words };
        if most.is_some() { Ok(budget) } else { Err(budget.refusal_of(0)) }
    }

    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Whether the engine has an order of its own.
    pub const fn with_order(&self) -> bool {
        self.with_order
    }

    /// Counts words that are kept, by their bits. Whether the frame, with those of all tasks, is still
    /// within its budget.
    #[inline]
    pub fn take(&self, bits: &[u32]) -> bool {
        let count = match self.encoding {
            Encoding::Dense | Encoding::Sparse => bits.len() as u64,
            Encoding::List => bits.iter().map(|bits| u64::from(bits.count_ones())).sum(),
        };
        // Relaxed: a number that stops a search, and that nothing is read by.
        self.taken.fetch_add(count, Ordering::Relaxed).saturating_add(count) <= self.most
    }

    /// Whether more was found than the reply holds: then no more need be.
    #[inline]
    pub fn is_spent(&self) -> bool {
        self.taken.load(Ordering::Relaxed) > self.most
    }

    /// The end of a search.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`] where the budget is spent; the words found are then not all.
    pub fn check(&self) -> Result<(), ReserveError> {
        if self.is_spent() { Err(self.refusal_of(self.most + 1)) } else { Ok(()) }
    }

    /// The refusal of a mask of so many words (pairs of a list) or more.
    #[cold]
    fn refusal_of(&self, words: u64) -> ReserveError {
        let mask = MaskShape::exact(self.encoding, self.n, words, self.with_order);
        ReserveError::TooLarge {
            at_least_bytes: mask.extent_words().saturating_mul(WORD_BYTES),
            limit_bytes: self.limit_words.saturating_mul(WORD_BYTES),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::engine::HeapReply;

    proptest! {
        #[test]
        fn the_most_words_within_a_limit_fit_and_one_more_does_not(
            n in 0u32..5_000,
            limit in 0u64..20_000,
            with_order: bool,
        ) {
            let n = BoxCount::new(n);
            let extent = |words| MaskShape::sparse(n, words, words, with_order).extent_words();
            match MaskShape::sparse_words_within(n, limit, with_order) {
                Some(most) => {
                    prop_assert!(extent(most) <= limit);
                    prop_assert!(extent(most + 1) > limit);
                }
                None => prop_assert!(extent(0) > limit),
            }
        }
    }

    #[test]
    fn a_budget_is_spent_with_the_first_word_beyond() {
        let n = BoxCount::new(1_000);
        let reply = HeapReply::with_limit_bytes(4 * (3 * 64 + 1_000));
        let budget = WordBudget::new(n, Encoding::Sparse, true, &reply).expect("room for 64");
        assert!(budget.take(&[1; 40]) && budget.take(&[3; 24]) && !budget.is_spent());
        assert_eq!(budget.check(), Ok(()));
        assert!(!budget.take(&[1]) && budget.is_spent());
        let refusal = ReserveError::TooLarge {
            at_least_bytes: 4 * (3 * 80 + 1_000),
            limit_bytes: 4 * (3 * 64 + 1_000),
        };
        assert_eq!(budget.check(), Err(refusal), "65 words take the room of 80");
    }

    #[test]
    fn of_a_list_pairs_count_and_not_words() {
        let n = BoxCount::new(1_000);
        let reply = HeapReply::with_limit_bytes(8 * 100 + 4);
        let budget = WordBudget::new(n, Encoding::List, true, &reply).expect("room for 100");
        assert!(budget.take(&[u32::MAX; 3]) && budget.take(&[1; 4]) && !budget.is_spent());
        assert_eq!(budget.check(), Ok(()));
        assert!(!budget.take(&[0b1000]) && budget.is_spent());
        let refusal = ReserveError::TooLarge { at_least_bytes: 8 * 101, limit_bytes: 8 * 100 + 4 };
        assert_eq!(budget.check(), Err(refusal));
        let nothing = HeapReply::with_limit_bytes(0);
        assert!(WordBudget::new(n, Encoding::List, true, &nothing).is_ok(), "there may be no pair");
    }

    #[test]
    fn what_the_count_of_boxes_decides_is_refused_at_once() {
        let n = BoxCount::new(1_000);
        let refused = |encoding, limit_words: u64| {
            let reply = HeapReply::with_limit_bytes(4 * limit_words);
            WordBudget::new(n, encoding, true, &reply).err()
        };
        let too_large = |at_least_bytes, limit_bytes| {
            Some(ReserveError::TooLarge { at_least_bytes, limit_bytes })
        };
        let dense = n.dense_words();
        assert_eq!(refused(Encoding::Dense, dense), None);
        assert_eq!(refused(Encoding::Dense, dense - 1), too_large(4 * dense, 4 * (dense - 1)));
        assert_eq!(refused(Encoding::Sparse, 1_000), None);
        assert_eq!(refused(Encoding::Sparse, 999), too_large(4_000, 3_996));
    }

    #[test]
    fn without_a_limit_a_budget_is_all_words_there_can_be() {
        for n in [0, 1, 70, u32::MAX] {
            let n = BoxCount::new(n);
            for encoding in Encoding::ALL {
                let budget = WordBudget::new(n, encoding, true, &HeapReply::new()).expect("room");
                assert_eq!(budget.check(), Ok(()));
                let most = match encoding {
                    Encoding::List => n.pair_count(),
                    Encoding::Dense | Encoding::Sparse => n.sparse_words_max(),
                };
                assert!(budget.most >= most, "{encoding}");
            }
        }
    }
}
