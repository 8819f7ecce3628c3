//! Work that ends early where nobody waits for its answer any more.
//!
//! Who asks for an answer says whether it is still [`Wanted`]. Work that takes long looks at that every some tens of
//! microseconds, in any of its threads, and ends with an error that says so. What was cancelled once stays so, regardless
//! of what is said later: rows have been left out by then.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Tests of boxes from one look to the next: 10 to 20 µs of a thread, beside which a look, of 10 to 100 ns, is nothing.
/// Other work counts as so many tests as take as long.
const LOOK_TESTS: u64 = 1 << 16;
/// A box that is copied, counted or sorted, in tests.
pub(crate) const BOX_TESTS: u64 = 16;

/// Says whether somebody still waits for an answer.
pub trait Wanted: Send + Sync {
    /// Whether somebody does. Any thread asks, each some ten thousand times a second.
    fn is_wanted(&self) -> bool;
}

/// Whether work under way is to end. What its threads share; those who wait for nobody's leave have none that asks.
#[derive(Default)]
pub struct Cancel {
    asker: Option<Arc<dyn Wanted>>,
    is_cancelled: AtomicBool,
}

impl fmt::Debug for Cancel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Cancel").field(&self.is_cancelled).finish()
    }
}

impl Cancel {
    /// Work that always comes to its end.
    pub const fn never() -> Self {
        Self::by(None)
    }

    /// Work whose answer somebody may let go of.
    pub const fn by(asker: Option<Arc<dyn Wanted>>) -> Self {
        Self { asker, is_cancelled: AtomicBool::new(false) }
    }

    /// Who is asked, for a part of the work that is to be cancelled by itself.
    pub fn asker(&self) -> Option<Arc<dyn Wanted>> {
        self.asker.clone()
    }

    /// Whether it was cancelled, as a look has found.
    #[inline]
    pub fn is_cancelled(&self) -> bool {
        // Relaxed: a flag that ends work, and that nothing is read by.
        self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Looks whether it is cancelled.
    pub fn look(&self) -> bool {
        if let Some(asker) = &self.asker
            && !self.is_cancelled()
            && !asker.is_wanted()
        {
            self.is_cancelled.store(true, Ordering::Relaxed);
        }
        self.is_cancelled()
    }

    /// Counts the tests of a thread, and looks when they have taken a while. Whether it is cancelled.
    #[inline]
    pub(crate) fn look_after(&self, tests: u64, pace: &mut Pace) -> bool {
        if self.asker.is_none() {
            return false;
        }
        pace.0 = pace.0.saturating_add(tests);
        if pace.0 < LOOK_TESTS {
            return self.is_cancelled();
        }
        pace.0 = 0;
        self.look()
    }

    /// Rows of a batch, of so many at most, that take no longer than from one look to the next.
    pub(crate) fn rows_at_once(tests_a_row: usize, most: usize) -> usize {
        (LOOK_TESTS as usize / tests_a_row.max(1)).clamp(1, most)
    }
}

/// Tests of one thread since it last looked.
#[derive(Debug, Default)]
pub(crate) struct Pace(u64);

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU64;

    use super::*;

    /// Wanted but for the second look.
    #[derive(Default)]
    struct LetGoOnce(AtomicU64);

    impl Wanted for LetGoOnce {
        fn is_wanted(&self) -> bool {
            self.0.fetch_add(1, Ordering::Relaxed) != 1
        }
    }

    #[test]
    fn what_was_cancelled_stays_so() {
        let asker = Arc::new(LetGoOnce::default());
        let cancel = Cancel::by(Some(asker.clone()));
        assert!(!cancel.look() && !cancel.is_cancelled());
        for _ in 0..3 {
            assert!(cancel.look() && cancel.is_cancelled());
        }
        assert_eq!(asker.0.load(Ordering::Relaxed), 2, "nobody is asked again");
        assert!(!Cancel::never().look());
    }

    #[test]
    fn a_thread_looks_after_so_many_tests() {
        let asker = Arc::new(LetGoOnce::default());
        let (cancel, mut pace) = (Cancel::by(Some(asker.clone())), Pace::default());
        for _ in 0..LOOK_TESTS - 1 {
            assert!(!cancel.look_after(1, &mut pace));
        }
        assert_eq!(asker.0.load(Ordering::Relaxed), 0);
        assert!(!cancel.look_after(1, &mut pace), "the first look");
        assert!(cancel.look_after(u64::MAX, &mut pace), "the second");
    }
}
