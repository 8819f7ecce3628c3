//! The thread that beats for the worker, and ends it where it hangs.
//!
//! The beats say that the process runs: they stop where it is stopped, and go on while it works on a long
//! frame. Whether it serves is another question. The worker thread that looks for requests comes by twice a second;
//! where none has for a long time and every thread sleeps, worker threads wait for each other, and the process ends,
//! to be replaced. A worker thread that works or waits for a processor is runnable, and one that waits for memory or
//! a disk is in an uninterruptible sleep: such a worker is left alone.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use pairmask_transport::{BEAT_INTERVAL, Heartbeat, RuntimeDir, Stillness};
use pairmask_wire::InstanceName;
use rustix::thread::gettid;

use super::{ServeError, StoppedThread};

const LOOK_INTERVAL: Duration = Duration::from_millis(500);
/// Worker threads that sleep, all of them, for this long without a look for requests, hang: the one that leads looks
/// twice a second, and a frame that is under way on a GPU is looked at all the time.
const HANGS_AFTER: Duration = Duration::from_secs(10);

pub(super) struct Beating {
    /// Rounds of the worker threads: one that looks for requests counts them.
    pub(super) rounds: Arc<AtomicU64>,
    _thread: StoppedThread,
}

impl Beating {
    pub(super) fn start(dir: &RuntimeDir, instance: &InstanceName) -> Result<Self, ServeError> {
        let heart = Heartbeat::start(dir, instance)?;
        let rounds = Arc::default();
        let counted = Arc::clone(&rounds);
        let name = instance.clone();
        let work = move |stop: &AtomicBool| beat(heart, &counted, stop, &name);
        let thread = StoppedThread::start("heartbeat", "starting the heartbeat", work)?;
        Ok(Self { rounds, _thread: thread })
    }
}

fn beat(mut heart: Heartbeat, rounds: &AtomicU64, stop: &AtomicBool, instance: &InstanceName) {
    let (mut workers, mut look_at, mut is_reported) = (watch_workers(), Instant::now(), false);
    let mut last_round = 0;
    while !stop.load(Ordering::Relaxed) {
        if let Err(error) = heart.beat()
            && !std::mem::replace(&mut is_reported, true)
        {
            log::warn!(
                "clients will take this daemon for silent, its heartbeat cannot be written: {error}"
            );
        }
        let now = Instant::now();
        if now >= look_at {
            look_at = now + LOOK_INTERVAL;
            let round = rounds.load(Ordering::Relaxed);
            // A look at all threads takes up to a millisecond: only where the worker threads are quiet.
            let all_sleep = std::mem::replace(&mut last_round, round) == round && others_sleep();
            if workers_hang(&mut workers, round, all_sleep, now) {
                log::error!(
                    "the worker of '{instance}' hangs: all its threads have slept for {HANGS_AFTER:?} and none looked for requests; ending it"
                );
                std::process::abort();
            }
        }
        std::thread::park_timeout(BEAT_INTERVAL);
    }
}

fn watch_workers() -> Stillness {
    Stillness::new(None, Instant::now(), 2 * LOOK_INTERVAL)
}

fn workers_hang(workers: &mut Stillness, rounds: u64, all_sleep: bool, now: Instant) -> bool {
    // No worker thread has begun yet, or one is at work: that counts as movement.
    let seen = (rounds > 0 && all_sleep).then_some(rounds);
    workers.look(seen, now) >= HANGS_AFTER
}

/// Whether all threads of this process but this one sleep, until something wakes them.
fn others_sleep() -> bool {
    threads_sleep("/proc/self/task", &gettid().as_raw_nonzero().to_string())
}

/// Whether all threads in a process's list sleep, but one of this id.
pub(super) fn threads_sleep(list: impl AsRef<Path>, but: &str) -> bool {
    let Ok(threads) = fs::read_dir(list) else { return false };
    threads.flatten().filter(|thread| thread.file_name().to_str() != Some(but)).all(|thread| {
        // One that has ended meanwhile does not work.
        fs::read_to_string(thread.path().join("stat")).map_or(true, |stat| sleeps(&stat))
    })
}

fn sleeps(stat: &str) -> bool {
    // The name before the state may hold anything, parentheses too.
    stat.rsplit_once(')').is_some_and(|(_, rest)| rest.trim_start().starts_with('S'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_work_or_page_do_not_sleep() {
        for (stat, expected) in [
            ("7 (worker-1) S 1 7", true),
            ("7 (a) S) R 1 7", false),
            ("7 (a) R) S 1 7", true),
            ("7 (worker-1) D 1 7", false),
            ("7 (worker-1) R 1 7", false),
            ("7 (worker-1) T 1 7", false),
            ("", false),
        ] {
            assert_eq!(sleeps(stat), expected, "{stat}");
        }
    }

    #[test]
    fn workers_hang_only_where_all_sleep_and_none_looks_for_long() {
        let start = Instant::now();
        let second = Duration::from_secs(1);
        let hang_at = |seen: &dyn Fn(u32) -> (u64, bool)| {
            let mut workers = watch_workers();
            (0..60).find(|i| {
                let (rounds, all_sleep) = seen(*i);
                workers_hang(&mut workers, rounds, all_sleep, start + *i * second)
            })
        };
        assert_eq!(hang_at(&|_| (5, true)), Some(10));
        assert_eq!(hang_at(&|_| (0, true)), None, "it has not begun");
        assert_eq!(hang_at(&|i| (1 + u64::from(i), true)), None, "it serves");
        assert_eq!(hang_at(&|_| (5, false)), None, "it works");
        assert_eq!(hang_at(&|i| (5, i % 10 != 5)), None, "it pages");
        assert_eq!(hang_at(&|i| (5, i > 20)), Some(31));
    }
}
