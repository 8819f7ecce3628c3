//! The pool of threads on which large frames are culled, one at a time.

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Instant;

use pairmask_core::AwakePool;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use super::cpu_time::{CpuTimer, note_in_pool};

/// As many threads as there are cores, of which the one that made the pool is the first: its parallel
/// loops start without a hand-over to another thread.
pub struct EnginePool {
    pool: ThreadPool,
    /// Held while a frame is culled in the pool.
    awake: Mutex<AwakePool>,
}

impl EnginePool {
    /// A pool of `threads` threads, with this one as its first.
    ///
    /// # Errors
    /// The system starts no thread, or this one belongs to a pool.
    pub fn with_this_thread(threads: usize) -> Result<Self, ThreadPoolBuildError> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .use_current_thread()
            .thread_name(|index| format!("engine-{index}"))
            .build()?;
        Ok(Self { pool, awake: Mutex::default() })
    }

    /// Threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Does work in the pool, as soon as no other thread does: on this thread where it is the pool's
    /// own, else on one that is handed the work.
    pub fn work<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.work_in(&self.awake(), work)
    }

    /// Does work in the pool with `true`, or where another thread works there with `false` on this thread, at once:
    /// for what must not wait for the end of a large frame.
    pub fn work_here_if_taken<R: Send>(&self, work: impl FnOnce(bool) -> R + Send) -> R {
        match self.awake.try_lock() {
            Ok(awake) => self.work_in(&awake, || work(true)),
            Err(TryLockError::Poisoned(awake)) => self.work_in(&awake.into_inner(), || work(true)),
            Err(TryLockError::WouldBlock) => work(false),
        }
    }

    fn work_in<R: Send>(&self, awake: &AwakePool, work: impl FnOnce() -> R + Send) -> R {
        if self.pool.current_thread_index().is_some() {
            return awake.work(|| self.pool.install(work));
        }
        let timed = || {
            let timer = CpuTimer::start();
            (work(), timer.elapsed())
        };
        let (result, used) = awake.work(|| self.pool.install(timed));
        note_in_pool(used);
        result
    }

    /// Keeps `threads` threads awake until `until`, this one among them. Does nothing on a thread that
    /// is not the pool's own, and while another one works in the pool.
    pub fn keep_until(&self, threads: usize, until: Instant) {
        match self.awake.try_lock() {
            Ok(mut awake) => awake.keep_until(threads, until),
            Err(TryLockError::Poisoned(awake)) => awake.into_inner().keep_until(threads, until),
            Err(TryLockError::WouldBlock) => {}
        }
    }

    fn awake(&self) -> MutexGuard<'_, AwakePool> {
        self.awake.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
