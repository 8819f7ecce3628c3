//! A team: the calling thread and some threads of its rayon pool, which do the phases of one frame together.
//!
//! A loop of rayon wakes more threads than it has parts, and each of them looks for work for some tens of µs: a frame of
//! 0.3 ms took 3 ms of CPU time on 16 cores. A team has as many threads as its frame is worth. They are called when
//! the frame begins, stay from phase to phase, and leave with the frame, or where a serial part takes long; the next
//! phase calls them again then. Nobody waits for one that comes late, or never: the others take its parts.
//!
//! ```text
//! enter     a team for a frame                     an engine, a scene, a query
//! share     one phase: parts, taken in turns       in_parts
//! help      what a called thread does
//! ```
//!
//! `phases` keeps a phase's borrows from threads that outlive it.
#![allow(unsafe_code)]

mod parts;
mod phases;
mod worth;

use std::cell::{Cell, UnsafeCell};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{self, AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use self::phases::Phases;
use crate::spinner::Spinner;

pub(crate) use parts::{Split, appended, for_each_in_parts, in_parts, part_count, zip_in_parts};
pub(crate) use worth::{most_threads, threads_by_share, threads_for, threads_worth, time_ns};

/// How long a helper of a small team waits for the next phase before it leaves, and is called again by the next: the
/// serial parts of a frame take less, but for those of large scenes, during which it would burn a core. The frames of
/// a larger team are longer, and so are those parts: for every so many threads it waits as long again.
const LINGER: Duration = Duration::from_micros(50);
const LINGER_THREADS: usize = 4;
/// Helpers that a thread calls when it comes: waking one takes 50 to 100 µs on a virtual machine, so that 15 who called
/// one another in a row would come within a ms, and come within .3 ms.
const CALLED: usize = 2;

thread_local! {
    /// The team of the frame that this thread is at; none while it does a part, so that what a part shares is
    /// done by its thread alone.
    static CURRENT: Cell<Option<Arc<Team>>> = const { Cell::new(None) };
    /// The team of this thread's last frame, for the next one.
    static SPARE: Cell<Option<Arc<Team>>> = const { Cell::new(None) };
}

/// What the threads of a frame share.
#[derive(Default)]
pub(crate) struct Team {
    /// Helpers that may be there at once.
    most_helpers: usize,
    /// Helpers that were called and have not left.
    helpers: AtomicUsize,
    phases: Phases,
    /// Whether the frame is done.
    is_over: AtomicBool,
    /// Whether a helper panicked in the phase.
    has_panicked: AtomicBool,
    work: UnsafeCell<Option<Phase>>,
}

/// What each thread does in a phase: takes parts until none is left.
#[derive(Clone, Copy)]
struct Phase(*const (dyn Fn() + Sync));

// SAFETY: `work` is written by the caller alone, while the phase is closed and nobody is inside, and read by helpers
// inside of an open phase alone; `phases` orders the two. The pointer is to what is `Sync`.
unsafe impl Sync for Team {}
// SAFETY: as above; nothing of a team belongs to a thread.
unsafe impl Send for Team {}

/// A frame under way. It ends when this is dropped.
#[must_use = "the frame ends when this is dropped"]
pub(crate) struct Frame {
    /// The team that this frame has made for itself.
    own: Option<Arc<Team>>,
}

impl Drop for Frame {
    fn drop(&mut self) {
        if let Some(team) = self.own.take() {
            team.is_over.store(true, Ordering::Release);
            CURRENT.set(None);
            SPARE.set(Some(team));
        }
    }
}

/// Begins a frame with up to `threads` threads, this one among them. Within another frame, it is a part of that one, and
/// has its threads.
pub(crate) fn enter(threads: usize) -> Frame {
    let current = CURRENT.take();
    let is_shared = current.is_none() && threads > 1;
    let own = is_shared.then(|| {
        // A helper that has not left yet keeps its own.
        let mut spare = SPARE.take().unwrap_or_default();
        match Arc::get_mut(&mut spare) {
            Some(team) => team.begin(threads - 1),
            None => spare = Arc::new(Team { most_helpers: threads - 1, ..Team::default() }),
        }
        spare
    });
    if let Some(team) = &own {
        team.call_helpers();
    }
    CURRENT.set(current.or_else(|| own.clone()));
    Frame { own }
}

/// Puts the team of a thread back when it is dropped, after a panic too.
struct Restore(Option<Arc<Team>>);

impl Drop for Restore {
    fn drop(&mut self) {
        CURRENT.set(self.0.take());
    }
}

/// Has the threads of this thread's team call `work`, this one too, and returns when all that came have returned from it.
pub(crate) fn share(work: &(dyn Fn() + Sync)) {
    let Some(team) = CURRENT.take() else { return work() };
    let _restore = Restore(Some(Arc::clone(&team)));
    team.call_helpers();
    let open = team.open(work);
    work();
    drop(open);
    if team.has_panicked.swap(false, Ordering::Relaxed) {
        // Where a part panics, so does the frame, in any thread.
        resume_unwind(Box::new("a thread of the frame's team panicked"));
    }
}

/// An open phase. It is closed, and empty, when this is dropped, after a panic too.
struct Open<'a>(&'a Team);

impl Drop for Open<'_> {
    fn drop(&mut self) {
        let mut spinner = Spinner::default();
        self.0.phases.close(|| spinner.turn());
    }
}

impl Team {
    /// Makes a team that nobody else holds one of another frame.
    fn begin(&mut self, most_helpers: usize) {
        self.most_helpers = most_helpers;
        *self.helpers.get_mut() = 0;
        *self.is_over.get_mut() = false;
    }

    fn open<'a>(&'a self, work: &'a (dyn Fn() + Sync)) -> Open<'a> {
        let work: *const (dyn Fn() + Sync + 'a) = work;
        #[allow(clippy::transmute_ptr_to_ptr)] // A cast cannot extend a lifetime.
        // SAFETY: only the lifetime differs. The pointer is used by helpers inside of this phase, and `Open` waits
        // for them before the borrow ends.
        let work = unsafe {
            std::mem::transmute::<*const (dyn Fn() + Sync + 'a), *const (dyn Fn() + Sync)>(work)
        };
        // SAFETY: the phase is closed and nobody is inside, see `Open`, and one thread alone calls this: that which
        // took the team from `CURRENT`.
        unsafe { *self.work.get() = Some(Phase(work)) };
        self.phases.open();
        Open(self)
    }

    /// Calls helpers that are not there. Each of them calls the next ones: a call takes some µs, and makes a small
    /// object, a job of rayon's.
    fn call_helpers(self: &Arc<Self>) {
        // The caller and a helper may call at once: no more come than may be there.
        let one_more = |helpers| (helpers < self.most_helpers).then_some(helpers + 1);
        for _ in 0..CALLED {
            if self.helpers.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_more).is_err() {
                return;
            }
            let team = Arc::clone(self);
            rayon::spawn(move || {
                if !team.is_over.load(Ordering::Acquire) {
                    team.call_helpers();
                    team.help();
                }
                team.helpers.fetch_sub(1, Ordering::Relaxed);
            });
        }
    }

    /// Does phases until the frame is over, or none has come for a while.
    fn help(&self) {
        let (mut done, mut spinner) = (None, Spinner::default());
        let mut came = Instant::now();
        let linger = LINGER * (1 + (self.most_helpers / LINGER_THREADS) as u32);
        while !self.is_over.load(Ordering::Acquire) {
            let opened = self.phases.opened().filter(|phase| done != Some(*phase));
            if let Some(phase) = opened {
                self.do_phase(phase);
                (done, came) = (opened, Instant::now());
            } else if came.elapsed() > linger {
                return;
            }
            spinner.turn();
        }
    }

    fn do_phase(&self, phase: u32) {
        let Some(_inside) = self.phases.enter(phase) else { return };
        // SAFETY: the phase is open and this thread is inside: the caller closes it and waits before it writes `work`,
        // or ends what it borrows.
        let work = unsafe { *self.work.get() };
        // SAFETY: as above.
        let run = || work.map(|Phase(work)| unsafe { (*work)() });
        if catch_unwind(AssertUnwindSafe(run)).is_err() {
            self.has_panicked.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::sync::Mutex;
    use std::sync::atomic::AtomicU64;
    use std::thread;

    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::spinner::Spinner;

    fn in_pool<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
        ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(work)
    }

    /// The sum of some numbers, in so many parts.
    fn sum(numbers: &mut [u64], parts: usize) -> u64 {
        in_parts(numbers, parts, &|part: &mut [u64]| part.iter().sum(), &|a: u64, b| a + b)
    }

    /// Shares phases until all members have come, and returns them.
    fn members(team: usize) -> usize {
        let seen = Mutex::new(HashSet::new());
        let count = || seen.lock().map_or(0, |seen| seen.len());
        let came = Instant::now();
        while count() < team && came.elapsed() < Duration::from_secs(60) {
            share(&|| {
                if let Ok(mut seen) = seen.lock() {
                    seen.insert(thread::current().id());
                }
                // Long enough for a thread that is called to come meanwhile.
                let mut spinner = Spinner::default();
                (0..1_000).for_each(|_| spinner.turn());
            });
        }
        count()
    }

    #[test]
    fn phases_of_frames_are_done_whichever_threads_come() {
        in_pool(4, || {
            let mut numbers: Vec<u64> = (0..3_000).collect();
            let mut pauses = 0;
            for frame in 0..2_000 {
                let _team = enter(1 + frame % 5);
                for parts in [1, 2, 7, 64, 1_000] {
                    assert_eq!(sum(&mut numbers, parts), 2_999 * 1_500, "frame {frame}");
                }
                if frame % 50 == 0 {
                    thread::sleep(LINGER * pauses);
                    pauses = (pauses + 1) % 4;
                }
            }
        });
    }

    #[test]
    fn a_team_has_as_many_threads_as_it_may_have() {
        for threads in [2, 3] {
            let came = in_pool(6, || {
                let _team = enter(threads);
                members(threads)
            });
            assert_eq!(came, threads);
        }
    }

    #[test]
    fn helpers_that_left_are_called_again() {
        in_pool(2, || {
            let _team = enter(2);
            assert_eq!(members(2), 2);
            thread::sleep(20 * LINGER);
            assert_eq!(members(2), 2);
        });
    }

    #[test]
    fn without_a_team_and_within_a_part_the_thread_is_alone() {
        in_pool(3, || {
            let here = thread::current().id();
            share(&|| assert_eq!(thread::current().id(), here));
            let _team = enter(3);
            let shared = AtomicU64::new(0);
            share(&|| {
                let here = thread::current().id();
                share(&|| {
                    assert_eq!(thread::current().id(), here);
                    shared.fetch_add(1, Ordering::Relaxed);
                });
            });
            assert!(shared.into_inner() > 0);
        });
    }

    #[test]
    fn a_frame_within_a_frame_has_its_threads() {
        in_pool(3, || {
            let _team = enter(3);
            drop(enter(2));
            assert_eq!(members(3), 3, "the outer one goes on");
        });
        assert!(CURRENT.take().is_none());
    }

    #[test]
    fn a_part_that_panics_ends_the_frame_and_not_the_threads() {
        in_pool(3, || {
            let frame = |bad: u64| {
                let _team = enter(3);
                let mut numbers: Vec<u64> = (0..300).collect();
                let part = |part: &mut [u64]| assert!(!part.contains(&bad), "as a test needs");
                in_parts(numbers.as_mut_slice(), 50, &part, &|(), ()| ());
            };
            for bad in [0, 7, 150, 299] {
                assert!(catch_unwind(|| frame(bad)).is_err(), "{bad}");
                frame(1_000);
            }
        });
    }
}
