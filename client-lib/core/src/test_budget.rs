//! How many boxes, or columns, a search may test before another way takes less time.

use std::sync::atomic::{AtomicI64, Ordering};

/// Tests of a thread that are counted together: those of a full batch of strips.
const LOT: i64 = 1 << 14;

/// Tests that are left, counted by all threads of a search.
pub(crate) struct TestBudget(AtomicI64);

// Relaxed: a number that stops a search, and that nothing is read by.
impl TestBudget {
    /// So many tests.
    pub const fn new(tests: i64) -> Self {
        Self(AtomicI64::new(tests))
    }

    /// Counts tests at once; a negative number gives some back.
    #[inline]
    pub fn take(&self, tests: i64) {
        self.0.fetch_sub(tests, Ordering::Relaxed);
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
