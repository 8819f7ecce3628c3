//! The pool of threads on which large frames are culled, one at a time.
//!
//! What a request takes is CPU time, of the thread that serves it and of one of the pool that works for it.
//! Wall time is no measure of work: it counts what a thread waited for its core, and a client whose worker
//! thread was interrupted would be taken for one with large frames.

use std::cell::Cell;
use std::sync::{Mutex, TryLockError};
use std::time::Duration;

use crate::locked;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};

/// As many threads as there are cores, of which the one that made the pool is the first: its parallel
/// loops start without a hand-over to another thread.
pub struct EnginePool {
    pool: ThreadPool,
    /// Held while a frame is culled in the pool.
    turn: Mutex<()>,
}

impl EnginePool {
    pub fn with_this_thread(threads: usize) -> Result<Self, ThreadPoolBuildError> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .use_current_thread()
            .thread_name(|index| format!("engine-{index}"))
            .build()?;
        Ok(Self { pool, turn: Mutex::default() })
    }

    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Does work in the pool, as soon as no other thread does: on this thread where it is the pool's
    /// own, else on one that is handed the work.
    pub fn work<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        let _turn = locked(&self.turn);
        self.work_in(work)
    }

    /// Does work by so many threads: by more than one in the pool.
    pub fn work_by<R: Send>(&self, threads: usize, work: impl FnOnce() -> R + Send) -> R {
        if threads == 1 { work() } else { self.work(work) }
    }

    /// Does work in the pool with `true`, or where another thread works there with `false` on this thread, at once:
    /// for what must not wait for the end of a large frame.
    pub fn work_here_if_taken<R: Send>(&self, work: impl FnOnce(bool) -> R + Send) -> R {
        let _turn = match self.turn.try_lock() {
            Ok(turn) => turn,
            Err(TryLockError::Poisoned(turn)) => turn.into_inner(),
            Err(TryLockError::WouldBlock) => return work(false),
        };
        self.work_in(|| work(true))
    }

    fn work_in<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        if self.pool.current_thread_index().is_some() {
            return self.pool.install(work);
        }
        let timed = || {
            let timer = CpuTimer::start();
            (work(), timer.elapsed())
        };
        let (result, used) = self.pool.install(timed);
        IN_POOL.set(IN_POOL.get() + used);
        result
    }
}

thread_local! {
    /// What threads of the pool have used for this one so far.
    static IN_POOL: Cell<Duration> = const { Cell::new(Duration::ZERO) };
}

/// Measures CPU time from a moment on. One of the two looks costs 0.2 µs: a system call.
#[derive(Clone, Copy, Debug)]
pub struct CpuTimer {
    start: Duration,
}

impl CpuTimer {
    pub fn start() -> Self {
        Self { start: used_by(ClockId::ThreadCPUTime) + IN_POOL.get() }
    }

    /// What this thread has used since, with the pool's work for it. For the thread that began.
    pub fn elapsed(&self) -> Duration {
        (used_by(ClockId::ThreadCPUTime) + IN_POOL.get()).saturating_sub(self.start)
    }
}

/// CPU time of this thread or process so far.
pub(crate) fn used_by(clock: ClockId) -> Duration {
    let used = clock_gettime(clock);
    // The clock counts from zero.
    Duration::new(used.tv_sec.unsigned_abs(), used.tv_nsec.unsigned_abs() as u32)
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Computes for so long on this thread's own clock.
    fn compute(time: Duration) {
        let timer = CpuTimer::start();
        while timer.elapsed() < time {
            std::hint::spin_loop();
        }
    }

    #[test]
    fn what_a_thread_waits_is_not_counted() {
        let (timer, start) = (CpuTimer::start(), Instant::now());
        std::thread::sleep(30 * MS);
        let waited = timer.elapsed();
        assert!(start.elapsed() >= 30 * MS && waited < 15 * MS, "{waited:?}");
        compute(5 * MS);
        assert!(timer.elapsed() >= waited + 5 * MS);
    }

    #[test]
    fn what_a_thread_of_the_pool_does_counts_for_the_one_that_handed_it_over() {
        let run = || {
            let pool = EnginePool::with_this_thread(2).map_err(drop).ok();
            let Some(pool) = pool else { panic!("a pool of two threads") };
            let of_the_pool = CpuTimer::start();
            pool.work(|| compute(5 * MS));
            assert!(of_the_pool.elapsed() >= 5 * MS);
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let timer = CpuTimer::start();
                    pool.work(|| compute(5 * MS));
                    assert!(timer.elapsed() >= 5 * MS);
                });
            });
        };
        let ended = std::thread::spawn(run).join();
        assert!(ended.is_ok(), "see above");
    }
}
