//! How many boxes, or columns, a search may test before another way takes less time.

use std::sync::atomic::{AtomicI64, Ordering};

/// Tests that are left, counted by all threads of a search.
pub(crate) struct TestBudget(AtomicI64);

// Relaxed: a number that stops a search, and that nothing is read by.
impl TestBudget {
    /// So many tests.
    pub const fn new(tests: i64) -> Self {
        Self(AtomicI64::new(tests))
    }

    /// Counts tests; a negative number gives some back.
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
