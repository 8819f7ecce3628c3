//! Has threads of the pool awake when the next frame of this process is due.
//!
//! A thread that finds no work sleeps after 10 to 20 µs, and is woken in 50 to 100 µs on a virtual machine: a game that
//! asks 60 times a second pays that in each frame that several threads share. A session learns when its frames come, as
//! a daemon does ([`rhythm`](pairmask_core::rhythm)), and a thread of its own calls a few threads of the pool shortly
//! before. The pool is the program's: what it has to do meanwhile is done first, and whoever waits for other work there
//! is held up by [`HOLD`] at most.
//!
//! Only sessions that answer in process, at a steady pace, with several threads, from outside of the pool have that
//! thread. It sleeps but for a few hundred µs a frame.

use std::process;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use pairmask_core::rhythm::Rhythm;
use pairmask_core::spinner::Spinner;

use super::spares::lock;

/// How long a thread of the pool is held before it looks for other work again. It looks for 10 to 20 µs before it
/// sleeps, and is called again within that time.
const HOLD: Duration = Duration::from_micros(10);

/// Most threads that are called: a frame begins with these, and they wake the others. At 240 Hz two take 15 % of a core
/// more of a program's 16, four take 21 % and gain little more.
const MOST_CALLED: usize = 2;

/// An edit that takes less than this is one thread's, or might as well be.
const SHARED_EDIT: Duration = Duration::from_micros(200);

/// The pace of a session's frames in process.
#[derive(Default)]
pub(super) struct Pace {
    /// Whether several threads have shared a frame: until then there is nothing to follow.
    is_followed: AtomicBool,
    shared: Arc<Shared>,
    thread: Mutex<Option<Caller>>,
}

/// The thread that calls others, and the process that started it: a fork has none.
struct Caller {
    thread: JoinHandle<()>,
    process: u32,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    rhythm: Rhythm<()>,
    /// Threads that the last frame used.
    threads: usize,
    /// Frames under way.
    at_work: usize,
    /// Whether the thread sleeps until it is told of a rhythm.
    awaits_rhythm: bool,
    /// Whether threads are held, until it is set.
    end_of_call: Option<Arc<AtomicBool>>,
    is_over: bool,
}

impl State {
    /// Lets the threads go that were called.
    fn end_call(&mut self) {
        if let Some(end) = self.end_of_call.take() {
            end.store(true, Ordering::Relaxed);
        }
    }
}

/// A frame under way.
pub(super) struct Working<'a> {
    pace: &'a Pace,
    is_followed: bool,
    began: Instant,
    threads: usize,
}

impl Working<'_> {
    /// So many threads shared it.
    pub(super) fn used(&mut self, threads: usize) {
        self.threads = threads;
    }

    /// So many threads could share it, and did where it took long.
    pub(super) fn may_have_used(&mut self, threads: usize) {
        self.threads = if self.began.elapsed() < SHARED_EDIT { 1 } else { threads };
    }
}

impl Drop for Working<'_> {
    fn drop(&mut self) {
        if self.is_followed {
            self.pace.end(self.threads);
        } else if self.threads > 1 {
            self.pace.is_followed.store(true, Ordering::Relaxed);
        }
    }
}

impl Pace {
    /// A frame begins.
    pub(super) fn begin(&self) -> Working<'_> {
        let began = Instant::now();
        // Of which pool a thread is cannot be told, and one that begins a frame is awake.
        let is_followed =
            self.is_followed.load(Ordering::Relaxed) && rayon::current_thread_index().is_none();
        if is_followed {
            let mut state = lock(&self.shared.state);
            state.end_call();
            state.at_work += 1;
            state.rhythm.note_request((), began);
        }
        Working { pace: self, is_followed, began, threads: 1 }
    }

    fn end(&self, threads: usize) {
        let mut state = lock(&self.shared.state);
        state.at_work -= 1;
        state.threads = threads;
        if state.at_work > 0 || threads < 2 || !state.rhythm.is_known() {
            return;
        }
        let is_reported = !std::mem::take(&mut state.awaits_rhythm);
        drop(state);
        if !is_reported {
            self.shared.changed.notify_one();
        }
        let mut caller = lock(&self.thread);
        if caller.is_none() {
            let shared = Arc::clone(&self.shared);
            let thread = Builder::new().name("pairmask-pace".into()).spawn(move || shared.call());
            // Without a thread frames wait for the pool, as the first ones do.
            *caller = thread.ok().map(|thread| Caller { thread, process: process::id() });
        }
    }
}

impl Drop for Pace {
    fn drop(&mut self) {
        let mut state = lock(&self.shared.state);
        state.is_over = true;
        state.end_call();
        drop(state);
        self.shared.changed.notify_one();
        let caller = self.thread.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(Caller { thread, process }) = caller
            && process == process::id()
        {
            // It has no work of others, and so does not panic.
            let _ = thread.join();
        }
    }
}

impl Shared {
    /// Calls threads whenever a frame is due, until the session is over.
    fn call(&self) {
        let mut state = lock(&self.state);
        while !state.is_over {
            let now = Instant::now();
            let is_wanted = state.at_work == 0 && state.threads > 1;
            let wake = if is_wanted { state.rhythm.next_wake(now) } else { None };
            let Some(wake) = wake else {
                state.awaits_rhythm = true;
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            let begins_in = wake.engines_at().saturating_duration_since(now);
            if !begins_in.is_zero() {
                let slept = self.changed.wait_timeout(state, begins_in);
                state = slept.unwrap_or_else(PoisonError::into_inner).0;
                continue;
            }
            let end = Arc::new(AtomicBool::new(false));
            state.end_of_call = Some(Arc::clone(&end));
            let threads = state.threads;
            drop(state);
            hold(threads, wake.spin_until, &end);
            state = lock(&self.state);
        }
    }
}

/// Keeps this many threads of the pool awake until then, or until `end` is set. One core is left to whoever makes the
/// frame.
fn hold(threads: usize, until: Instant, end: &Arc<AtomicBool>) {
    let others = rayon::current_num_threads().saturating_sub(1).max(1);
    let threads = threads.min(others).min(MOST_CALLED);
    let held = Arc::new(AtomicUsize::new(0));
    let mut spinner = Spinner::default();
    while !end.load(Ordering::Relaxed) && Instant::now() < until {
        // One at a time: of several that wait each would wake another thread.
        if held.load(Ordering::Relaxed) < threads {
            held.fetch_add(1, Ordering::Relaxed);
            let (held, end) = (Arc::clone(&held), Arc::clone(end));
            rayon::spawn(move || {
                let until = Instant::now() + HOLD;
                let mut spinner = Spinner::default();
                while !end.load(Ordering::Relaxed) && Instant::now() < until {
                    spinner.turn();
                }
                held.fetch_sub(1, Ordering::Relaxed);
            });
        }
        spinner.turn();
    }
}

#[cfg(test)]
mod tests {
    use std::thread::sleep;

    use super::*;

    const MS: Duration = Duration::from_millis(1);
    /// Much longer than anything takes here.
    const LONG: Duration = Duration::from_secs(60);

    fn frame(pace: &Pace, threads: usize) {
        pace.begin().used(threads);
    }

    /// Whether something comes about while frames come at a pace.
    fn comes_about(pace: &Pace, threads: usize, is_so: impl Fn(&Pace) -> bool) -> bool {
        let (start, mut due) = (Instant::now(), Instant::now());
        while start.elapsed() < LONG {
            due += 5 * MS;
            while Instant::now() < due {
                if is_so(pace) {
                    return true;
                }
                sleep(MS / 20);
            }
            frame(pace, threads);
        }
        false
    }

    fn is_calling(pace: &Pace) -> bool {
        lock(&pace.shared.state).end_of_call.is_some()
    }

    #[test]
    fn threads_are_called_before_a_frame_is_due_and_let_go_when_it_begins() {
        let pace = Pace::default();
        assert!(comes_about(&pace, 2, is_calling));
        let end = lock(&pace.shared.state).end_of_call.clone();
        frame(&pace, 2);
        assert!(end.is_none_or(|end| end.load(Ordering::Relaxed)));
    }

    #[test]
    fn a_session_that_has_ended_its_rhythm_sleeps() {
        let pace = Pace::default();
        assert!(comes_about(&pace, 2, |pace| lock(&pace.thread).is_some()));
        let start = Instant::now();
        while !lock(&pace.shared.state).awaits_rhythm {
            assert!(start.elapsed() < LONG);
            sleep(MS);
        }
        // It comes back with the rhythm.
        assert!(comes_about(&pace, 2, is_calling));
    }

    #[test]
    fn frames_of_one_thread_call_none() {
        let pace = Pace::default();
        for _ in 0..50 {
            frame(&pace, 1);
            sleep(MS);
        }
        assert!(lock(&pace.thread).is_none());
    }

    #[test]
    fn frames_from_within_a_pool_are_not_followed() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
        let pace = Pace::default();
        pool.install(|| {
            for _ in 0..50 {
                frame(&pace, 2);
                sleep(MS);
            }
        });
        assert!(lock(&pace.thread).is_none() && !lock(&pace.shared.state).rhythm.is_known());
    }

    #[test]
    fn held_threads_do_other_work_meanwhile() {
        let end = Arc::new(AtomicBool::new(false));
        let holding = {
            let end = Arc::clone(&end);
            std::thread::spawn(move || hold(usize::MAX, Instant::now() + LONG, &end))
        };
        // All of the pool's threads together, and each for itself.
        for _ in 0..100 {
            rayon::broadcast(|_| ());
            let sum: u64 = rayon::join(|| 1, || 2).0 + 2;
            assert_eq!(sum, 3);
        }
        end.store(true, Ordering::Relaxed);
        holding.join().expect("no panic");
    }
}
