//! How many boxes, or columns, a search may test before another way takes less time.

use std::sync::atomic::{AtomicI64, Ordering};

/// Tests of a thread that are counted together: those of a full batch of strips.
const LOT: i64 = 1 << 14;

/// What a spent budget is set to: no search gives so many tests back.
const SPENT: i64 = i64::MIN / 2;

/// Tests that are left, counted by all threads of a search.
///
/// A budget that was spent once stays spent: threads have left rows out by then, so that the pairs found, whatever
/// they allow, are not all.
pub(crate) struct TestBudget(AtomicI64);

// Relaxed: a number that stops a search, and that nothing is read by.
impl TestBudget {
    /// So many tests.
    pub const fn new(tests: i64) -> Self {
        Self(AtomicI64::new(tests))
    }

    /// Counts tests at once; a negative number gives some back, unless the budget is spent.
    #[inline]
    pub fn take(&self, tests: i64) {
        if self.0.fetch_sub(tests, Ordering::Relaxed).saturating_sub(tests) < 0 {
            // Who makes the number negative stores this, so that it lasts, also where another thread gave some back in
            // between.
            self.0.store(SPENT, Ordering::Relaxed);
        }
    }

    /// Whether more were made than may be.
    #[inline]
    pub fn is_spent(&self) -> bool {
        self.0.load(Ordering::Relaxed) < 0
    }
}

/// Tests of one thread that the budget does not know of yet.
///
/// All threads look at the budget all the time. Were each few tests counted there at once, they would take the number
/// from each other's caches: a frame of a million boxes took 16 threads 1.4 times as long.
#[derive(Default)]
pub(crate) struct TestLot(i64);

impl TestLot {
    /// Counts tests; a negative number gives some back.
    #[inline]
    pub fn take(&mut self, tests: i64, budget: &TestBudget) {
        self.0 = self.0.saturating_add(tests);
        if self.0.saturating_abs() >= LOT {
            budget.take(std::mem::take(&mut self.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_that_was_spent_stays_spent() {
        for (tests, given_back) in [(11, 11), (1 << 40, i64::MAX >> 2), (11, 1 << 50)] {
            let budget = TestBudget::new(10);
            budget.take(10);
            budget.take(-10);
            assert!(!budget.is_spent());
            budget.take(tests);
            budget.take(-given_back);
            assert!(budget.is_spent(), "{tests} {given_back}");
        }
    }

    #[test]
    fn what_one_of_many_threads_saw_spent_is_spent_for_all() {
        for round in 0..200 {
            let budget = TestBudget::new(100);
            let seen = std::thread::scope(|scope| {
                let threads: Vec<_> = (0..4)
                    .map(|thread| {
                        let budget = &budget;
                        scope.spawn(move || {
                            (0..100).fold(false, |seen, step| {
                                budget.take(if (round + thread + step) % 2 == 0 {
                                    40
                                } else {
                                    -40
                                });
                                seen | budget.is_spent()
                            })
                        })
                    })
                    .collect();
                threads.into_iter().any(|thread| thread.join().expect("no thread panics"))
            });
            assert!(!seen || budget.is_spent(), "round {round}");
        }
    }
}
