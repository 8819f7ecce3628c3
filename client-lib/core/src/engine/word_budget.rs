//! What a frame may take, shared by all of its tasks: words, or pairs, that the reply holds, and tests before
//! another engine is the better one.

use std::sync::atomic::{AtomicU64, Ordering};

use super::sure_pairs::{Body, Outlook, outlook};
use super::{CullError, EngineName, ReplyBuffer, ReserveError};
use crate::cancel::{Cancel, Pace};
use crate::mask::{Encoding, MaskShape};
use crate::test_budget::{TestBudget, TestLot};
use crate::units::BoxCount;

const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// Tests, for each box, after which an engine hands a crowded scene over: twelve strips, which take 15 to 250 ns as
/// the caches hold the boxes or not, up to about what `cpu-tree` takes for the whole frame. More would waste time in
/// such scenes, fewer would hand over scenes that the engine is right for: those take 20 to 75 tests a box.
const TESTS_A_BOX: i64 = 192;
/// Tests more for each pair that is found: any engine finds all pairs, and tests some boxes around each.
const TESTS_A_PAIR: i64 = 32;
/// Tests of scenes of any size.
const TESTS_LEAST: i64 = 1 << 20;

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
    tests: TestBudget,
    /// The engine, where it may hand the frame over.
    hands_over: Option<EngineName>,
    cancel: Cancel,
}

/// Tests of one thread that are not counted yet.
#[derive(Default)]
pub(crate) struct Tests {
    lot: TestLot,
    pace: Pace,
}

impl WordBudget {
    /// The budget of a mask of `n` boxes in memory of `reply`. The engine has an order of its own or
    /// keeps that of the boxes.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`] where the reply has no room, regardless of the boxes.
    pub fn new(
        n: BoxCount,
        encoding: Encoding,
        with_order: bool,
        reply: &dyn ReplyBuffer,
    ) -> Result<Self, ReserveError> {
        let limit_words = reply.limit_words();
        let most = MaskShape::words_within(encoding, n, limit_words, with_order);
        let taken = AtomicU64::new(0);
        let budget = Self {
            taken,
            most: most.unwrap_or(0),
            n,
            encoding,
            with_order,
            limit_words,
            tests: TestBudget::new(i64::MAX),
            hands_over: None,
            cancel: Cancel::by(reply.asker()),
        };
        if most.is_some() { Ok(budget) } else { Err(budget.refusal_of(0)) }
    }

    /// The same for an engine that hands the frame over after so many tests that another one takes less time for
    /// all of it, where it may.
    pub fn handing_over(mut self, engine: EngineName, may_hand_over: bool) -> Self {
        if may_hand_over {
            let tests = TESTS_A_BOX * i64::from(self.n.get());
            self.tests = TestBudget::new(tests.max(TESTS_LEAST));
            self.hands_over = Some(engine);
        }
        self
    }

    /// Refuses a mask of objects that is sure not to fit, before any pair is looked for: of all pairs, or of those of the
    /// `first` and the others. Whether it is not expected to fit either where that is not sure: then its words are better
    /// counted before they are kept.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`]; [`CullError::Cancelled`].
    pub fn look_at<T: Body>(
        &self,
        get: impl Fn(usize) -> Option<T>,
        first: Option<usize>,
    ) -> Result<bool, CullError> {
        let most_a_word = match self.encoding {
            // It is as long as it is.
            Encoding::Dense => return Ok(false),
            Encoding::Sparse => 32,
            Encoding::List => 1,
        };
        let beyond = self.most.saturating_mul(most_a_word);
        if self.n.pair_count() <= beyond {
            return Ok(false);
        }
        match outlook((self.n.len(), first), get, beyond, &self.cancel) {
            _ if self.cancel.is_cancelled() => Err(CullError::Cancelled),
            Outlook::AtLeast(pairs) => Err(self.refusal_of(pairs.div_ceil(most_a_word)).into()),
            Outlook::Expected(pairs) => Ok(pairs > beyond as f64),
        }
    }

    /// Counts tests of a task, and the pairs that they found. Looks whether the mask is wanted after some.
    #[inline]
    pub fn note_tests(&self, noted: &mut Tests, tests: u64, pairs: u64) {
        if self.hands_over.is_some() {
            let allowed = TESTS_A_PAIR.saturating_mul(pairs as i64);
            noted.lot.take((tests as i64).saturating_sub(allowed), &self.tests);
        }
        self.cancel.look_after(tests, &mut noted.pace);
    }

    /// Whether the mask is still wanted.
    pub const fn cancel(&self) -> &Cancel {
        &self.cancel
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

    /// Whether more was found than the reply holds, another engine takes over, or nobody waits any more: then no more
    /// need be found.
    #[inline]
    pub fn is_spent(&self) -> bool {
        self.is_full() || self.tests.is_spent() || self.cancel.is_cancelled()
    }

    fn is_full(&self) -> bool {
        self.taken.load(Ordering::Relaxed) > self.most
    }

    /// The end of a search.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`] where more was found than the reply holds, and [`CullError::TooCrowded`] where
    /// another engine takes over, and [`CullError::Cancelled`]; the words found are then not all.
    pub fn check(&self) -> Result<(), CullError> {
        match self.hands_over {
            _ if self.cancel.is_cancelled() => Err(CullError::Cancelled),
            _ if self.is_full() => Err(self.refusal_of(self.most + 1).into()),
            Some(engine) if self.tests.is_spent() => Err(CullError::TooCrowded { engine }),
            _ => Ok(()),
        }
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
    fn a_budget_is_spent_with_the_first_word_beyond_or_pair_of_a_list() {
        let n = BoxCount::new(1_000);
        for (encoding, limit_bytes, within, beyond, at_least_bytes) in [
            // 65 words take the room of 80.
            (
                Encoding::Sparse,
                4 * (3 * 64 + 1_000),
                [&[1; 40][..], &[3; 24]],
                1,
                4 * (3 * 80 + 1_000),
            ),
            (Encoding::List, 8 * 100 + 4, [&[u32::MAX; 3][..], &[1; 4]], 0b1000, 8 * 101),
        ] {
            let reply = HeapReply::with_limit_bytes(limit_bytes);
            let budget = WordBudget::new(n, encoding, true, &reply).expect("room");
            assert!(within.iter().all(|words| budget.take(words)) && !budget.is_spent());
            assert_eq!(budget.check(), Ok(()));
            assert!(!budget.take(&[beyond]) && budget.is_spent());
            let refusal = ReserveError::TooLarge { at_least_bytes, limit_bytes };
            assert_eq!(budget.check(), Err(refusal.into()), "{encoding}");
        }
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

    #[test]
    fn a_frame_is_handed_over_after_more_tests_than_pairs_explain() {
        let n = BoxCount::new(1_000_000);
        let budget = |may| {
            let budget = WordBudget::new(n, Encoding::Sparse, true, &HeapReply::new());
            budget.expect("no limit").handing_over(EngineName::CpuGrid, may)
        };
        let crowded = Err(CullError::TooCrowded { engine: EngineName::CpuGrid });
        for (tests, pairs, may, expected) in [
            (192_000_000, 0, true, Ok(())),
            (192_000_001, 0, true, crowded.clone()),
            (1_192_000_000, 31_250_000, true, Ok(())),
            (1_192_000_001, 31_250_000, true, crowded),
            (u64::MAX / 4, 0, false, Ok(())),
        ] {
            let budget = budget(may);
            budget.note_tests(&mut Tests::default(), tests, pairs);
            assert_eq!(budget.is_spent(), expected.is_err());
            assert_eq!(budget.check(), expected, "{tests} {pairs}");
            // Pairs found afterwards: rows are left out by then.
            budget.note_tests(&mut Tests::default(), 0, 1 << 32);
            assert_eq!(budget.check(), expected, "{tests} {pairs}");
        }
    }
}
