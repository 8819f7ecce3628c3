//! Threads of a rayon pool that stay awake from frame to frame.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::Yield;

use crate::spinner::Spinner;

/// Keeps threads of a rayon pool awake between and within frames.
///
/// A thread of a pool that finds no work sleeps after 10 to 20 µs. Waking it takes 50 to 100 µs on
/// a virtual machine, and the threads of a large pool wake one after the other: longer than a whole
/// small frame takes. An `AwakePool` has threads of the pool look for work until a deadline.
///
/// All calls come from one thread of the pool itself, see
/// [`ThreadPoolBuilder::use_current_thread`](rayon::ThreadPoolBuilder::use_current_thread). A thread
/// that looks for work yields its core in each round, but uses it fully while no other thread wants
/// it: keep a pool awake only while frames follow each other closely.
///
/// ```
/// use std::time::{Duration, Instant};
/// use pairmask_core::AwakePool;
/// use rayon::prelude::*;
///
/// rayon::ThreadPoolBuilder::new().num_threads(2).use_current_thread().build_global()?;
/// let mut awake = AwakePool::default();
/// for frame in 0..3_u64 {
///     let sum: u64 = awake.work(|| (0..1000_u64).into_par_iter().map(|x| x * frame).sum());
///     assert_eq!(sum, 499_500 * frame);
///     awake.keep_until(2, Instant::now() + Duration::from_micros(200));
/// }
/// # Ok::<(), rayon::ThreadPoolBuildError>(())
/// ```
#[derive(Debug, Default)]
pub struct AwakePool {
    watch: Option<Arc<Watch>>,
}

impl AwakePool {
    /// Keeps `threads` threads of the current pool awake until `until`, in place of the last call's
    /// number and time. The calling thread is one of them. Wakes no thread if `until` has passed,
    /// and does nothing outside of a pool.
    ///
    /// The first call, and one after the time has passed, wakes the threads, which costs some µs.
    /// Further calls with as many threads cost nothing.
    pub fn keep_until(&mut self, threads: usize, until: Instant) {
        let Some(caller) = rayon::current_thread_index() else { return };
        let others = threads.min(rayon::current_num_threads()).saturating_sub(1);
        if let Some(watch) = &self.watch {
            if watch.others == others && watch.extend(until) {
                return;
            }
            watch.end();
        }
        if others == 0 || until <= Instant::now() {
            return;
        }
        let watch = Arc::new(Watch::new(others, until));
        let shared = Arc::clone(&watch);
        rayon::spawn_broadcast(move |context| {
            // The first threads beside the caller: only their number matters.
            let index = context.index();
            let is_wanted = index != caller && index - usize::from(index > caller) < others;
            if is_wanted {
                shared.attend();
            }
        });
        self.watch = Some(watch);
    }

    /// Does work in the pool. All work of the pool has to be done in such calls.
    pub fn work<R>(&self, work: impl FnOnce() -> R) -> R {
        let _working = self.watch.as_deref().map(Working::begin);
        work()
    }
}

impl Drop for AwakePool {
    fn drop(&mut self) {
        if let Some(watch) = &self.watch {
            watch.end();
        }
    }
}

/// Marks work as under way until it is dropped, after a panic too.
struct Working<'a>(&'a Watch);

impl<'a> Working<'a> {
    fn begin(watch: &'a Watch) -> Self {
        // A thread that steals a part of the work sees this store.
        watch.is_working.store(true, Ordering::Release);
        Self(watch)
    }
}

impl Drop for Working<'_> {
    fn drop(&mut self) {
        self.0.is_working.store(false, Ordering::Release);
    }
}

/// Value of `until` after the time has passed: it is not extended any more.
const OVER: u64 = 0;

/// State that the awake threads share.
#[derive(Debug)]
struct Watch {
    /// Threads beside the calling one.
    others: usize,
    began: Instant,
    /// Nanoseconds after the beginning, or [`OVER`].
    until: AtomicU64,
    /// Whether work may be under way.
    is_working: AtomicBool,
    /// Whether a thread came during work and left.
    is_incomplete: AtomicBool,
}

impl Watch {
    fn new(others: usize, until: Instant) -> Self {
        let began = Instant::now();
        Self {
            others,
            began,
            until: AtomicU64::new(nanoseconds(began, until)),
            is_working: AtomicBool::new(false),
            is_incomplete: AtomicBool::new(false),
        }
    }

    /// Extends the time to `until`. Returns false if the threads leave: then new ones have to be
    /// started.
    fn extend(&self, until: Instant) -> bool {
        let extended = |seen| (seen != OVER).then(|| nanoseconds(self.began, until));
        !self.is_incomplete.load(Ordering::Relaxed)
            && self.until.fetch_update(Ordering::Relaxed, Ordering::Relaxed, extended).is_ok()
    }

    fn end(&self) {
        self.until.store(OVER, Ordering::Relaxed);
    }

    /// Whether the time has passed. Once it has for one thread, it has for all.
    fn is_over(&self) -> bool {
        let seen = self.until.load(Ordering::Relaxed);
        let is_late = || {
            // Work that began in time keeps its threads to its end.
            !self.is_working.load(Ordering::Relaxed)
                && nanoseconds(self.began, Instant::now()) > seen
        };
        let close =
            || self.until.compare_exchange(seen, OVER, Ordering::Relaxed, Ordering::Relaxed);
        seen == OVER || is_late() && close().is_ok()
    }

    /// Looks for work of the pool until the time has passed.
    fn attend(&self) {
        // A thread that comes here during a frame may hold a part of the frame that waits for
        // another thread. If it stayed, the frame would wait until the threads leave.
        if self.is_working.load(Ordering::Acquire) {
            self.is_incomplete.store(true, Ordering::Relaxed);
            return;
        }
        let mut spinner = Spinner::default();
        while !self.is_over() {
            if rayon::yield_now() != Some(Yield::Executed) {
                // The core is yielded in every round: the thread that takes the frame's answer may
                // want it at once.
                spinner.offer();
            }
        }
    }
}

/// From `start` to `end`, at least 1 and so never [`OVER`]; 584 years hold them.
fn nanoseconds(start: Instant, end: Instant) -> u64 {
    u64::try_from(end.saturating_duration_since(start).as_nanos()).unwrap_or(u64::MAX).max(1)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::thread;
    use std::time::Duration;

    use rayon::ThreadPoolBuilder;
    use rayon::prelude::*;

    use super::*;

    const LONG: Duration = Duration::from_secs(3600);

    /// Runs a test on the first thread of a pool.
    fn in_pool(threads: usize, test: impl FnOnce() + Send + 'static) {
        let run = move || {
            let _pool =
                ThreadPoolBuilder::new().num_threads(threads).use_current_thread().build().unwrap();
            test();
        };
        thread::spawn(run).join().unwrap();
    }

    /// Waits until no other thread holds the watch any more.
    fn await_end(watch: &Arc<Watch>) {
        while Arc::strong_count(watch) > 1 {
            // The calling thread has a task of the watch too, which does nothing.
            rayon::yield_now();
        }
    }

    #[test]
    fn threads_stay_until_they_are_asked_to_go() {
        in_pool(3, || {
            let mut awake = AwakePool::default();
            awake.keep_until(3, Instant::now() + LONG);
            let watch = Arc::clone(awake.watch.as_ref().unwrap());
            awake.keep_until(3, Instant::now() + LONG);
            assert!(Arc::ptr_eq(&watch, awake.watch.as_ref().unwrap()), "no thread is woken again");
            drop(awake);
            await_end(&watch);
        });
    }

    #[test]
    fn another_number_of_threads_is_another_watch() {
        in_pool(3, || {
            let mut awake = AwakePool::default();
            awake.keep_until(3, Instant::now() + LONG);
            let watch = awake.watch.clone().unwrap();
            awake.keep_until(2, Instant::now() + LONG);
            assert_eq!(awake.watch.as_ref().unwrap().others, 1);
            // The threads of the earlier watch leave.
            await_end(&watch);
            awake.keep_until(1, Instant::now() + LONG);
            assert_eq!(awake.watch.as_ref().map(|watch| watch.extend(Instant::now())), Some(false));
        });
    }

    #[test]
    fn no_thread_is_woken_for_a_time_that_has_passed() {
        in_pool(2, || {
            let mut awake = AwakePool::default();
            awake.keep_until(2, Instant::now());
            assert!(awake.watch.is_none());
        });
    }

    #[test]
    fn outside_of_a_pool_no_thread_is_kept_awake() {
        let mut awake = AwakePool::default();
        awake.keep_until(8, Instant::now() + LONG);
        assert!(awake.watch.is_none());
        assert_eq!(awake.work(|| 7), 7);
    }

    #[test]
    fn a_thread_that_comes_during_work_leaves_and_is_asked_again() {
        let watch = Watch::new(1, Instant::now() + LONG);
        watch.is_working.store(true, Ordering::Relaxed);
        watch.attend();
        assert!(!watch.extend(Instant::now() + LONG));
    }

    #[test]
    fn work_that_began_in_time_has_its_threads_to_the_end() {
        let watch = Watch::new(1, Instant::now());
        watch.is_working.store(true, Ordering::Relaxed);
        thread::sleep(Duration::from_millis(1));
        assert!(!watch.is_over());
        watch.is_working.store(false, Ordering::Relaxed);
        assert!(watch.is_over());
        assert!(!watch.extend(Instant::now() + LONG), "over for one is over for all");
    }

    #[test]
    fn work_that_panics_is_over_too() {
        in_pool(2, || {
            let mut awake = AwakePool::default();
            awake.keep_until(2, Instant::now() + LONG);
            let work = || awake.work(|| panic!("as a test wants"));
            assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).is_err());
            assert!(!awake.watch.as_ref().unwrap().is_working.load(Ordering::Relaxed));
        });
    }

    #[test]
    fn work_is_done_whichever_threads_are_awake() {
        in_pool(4, || {
            let mut awake = AwakePool::default();
            let items: Vec<u64> = (0..2000).collect();
            for frame in 0..500_u64 {
                let sum: u64 = awake.work(|| items.par_iter().map(|item| item * frame).sum());
                assert_eq!(sum, 1_999_000 * frame);
                // From threads that are gone before the next frame to some that outlive it.
                let until = Instant::now() + Duration::from_micros(frame % 7 * 30);
                awake.keep_until(2 + frame as usize / 100 % 3, until);
                if frame % 5 == 0 {
                    thread::sleep(Duration::from_micros(100));
                }
            }
        });
    }
}
