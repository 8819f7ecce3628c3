//! Hand-written synchronisation under a model of memory: loom runs each test in every order of its threads' steps, and
//! with every value that a load may see by C11's rules for these orderings and fences.
//!
//! loom, and not shuttle, which takes every atomic for sequentially consistent: what goes wrong here without a fence does
//! so by loads that see old values. What is checked is the code that runs: its files are compiled once more, with loom's
//! atomics in place of the standard library's. Each test has one beside it that must fail, where a fence is left out.
// Of each file, not all is used here, and some are compiled twice.
#![allow(dead_code, clippy::duplicate_mod)]

use loom::cell::UnsafeCell;
use loom::model::Builder;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use loom::thread;

/// The files as they are.
#[path = "../../../.."]
mod checked {
    use loom::sync::atomic;

    #[path = "client-lib/transport/src/handshake.rs"]
    pub mod handshake;
    #[path = "client-lib/core/src/team/phases.rs"]
    pub mod phases;
    #[path = "daemon/src/serve/worker_threads/sleeper.rs"]
    pub mod sleeper;
    #[path = "daemon/src/execute/turns.rs"]
    pub mod turns;
}

/// The same without their fences.
#[path = "../../../.."]
mod broken {
    mod atomic {
        pub use loom::sync::atomic::*;

        pub fn fence(_: Ordering) {}
    }

    #[path = "client-lib/transport/src/handshake.rs"]
    pub mod handshake;
    #[path = "client-lib/core/src/team/phases.rs"]
    pub mod phases;
    #[path = "daemon/src/serve/worker_threads/sleeper.rs"]
    pub mod sleeper;
}

/// Threads are interrupted at most so often in an order of steps, unless `PAIRMASK_TIER` is `nightly`: every fault that
/// is known shows with two.
const INTERRUPTIONS: usize = 3;

fn model(test: impl Fn() + Sync + Send + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(INTERRUPTIONS);
    if std::env::var("PAIRMASK_TIER").is_ok_and(|tier| tier == "nightly") {
        builder.preemption_bound = Some(2 * INTERRUPTIONS);
    }
    builder.check(test);
}

/// The leader goes to sleep while another thread leaves a frame with a GPU, looks who sleeps, and goes away. Nobody wakes
/// the leader before. One of the two has to see that the frame is to be published.
macro_rules! leave_a_frame {
    ($sleeper:ty) => {
        model(|| {
            let sleeper = Arc::new(<$sleeper>::default());
            let (under_way, has_looked) =
                (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
            let leader = {
                let (sleeper, under_way) = (Arc::clone(&sleeper), Arc::clone(&under_way));
                let has_looked = Arc::clone(&has_looked);
                thread::spawn(move || {
                    let is_busy = || under_way.load(Ordering::Relaxed) > 0;
                    sleeper.sleep_unless(is_busy, || {
                        while !has_looked.load(Ordering::Relaxed) {
                            thread::yield_now();
                        }
                    })
                })
            };
            under_way.fetch_add(1, Ordering::Relaxed);
            let is_seen = sleeper.watch().is_asleep();
            has_looked.store(true, Ordering::Relaxed);
            // A leader that begins to sleep later sees the frame.
            let has_seen = leader.join().unwrap();
            assert!(is_seen || has_seen, "a frame that nobody publishes");
        });
    };
}

#[test]
fn a_frame_left_with_a_gpu_is_seen_by_one_of_two() {
    leave_a_frame!(checked::sleeper::Sleeper);
}

#[test]
#[should_panic(expected = "a frame that nobody publishes")]
fn without_its_fences_a_sleeper_misses_a_frame() {
    leave_a_frame!(broken::sleeper::Sleeper);
}

/// A caller opens two phases, each with work of its own, and a helper does what it finds open. The work is read in its
/// phase alone: loom refuses a read beside the caller's write.
macro_rules! share_phases {
    ($phases:ty) => {
        model(|| {
            let phases = Arc::new(<$phases>::default());
            let work = Arc::new(UnsafeCell::new(0));
            let helper = {
                let (phases, work) = (Arc::clone(&phases), Arc::clone(&work));
                thread::spawn(move || {
                    for _ in 0..2 {
                        let Some(phase) = phases.opened() else { continue };
                        let Some(_inside) = phases.enter(phase) else { continue };
                        // SAFETY: as in `Team::do_phase`; loom checks it.
                        #[allow(unsafe_code)]
                        let done = work.with(|work| unsafe { *work });
                        assert_eq!(done, phase.div_ceil(2), "the work of another phase");
                    }
                })
            };
            for number in 1..=2 {
                // SAFETY: as in `Team::open`; loom checks it.
                #[allow(unsafe_code)]
                work.with_mut(|work| unsafe { *work = number });
                phases.open();
                phases.close(thread::yield_now);
            }
            helper.join().unwrap();
        });
    };
}

#[test]
fn work_is_read_in_its_phase_alone() {
    share_phases!(checked::phases::Phases);
}

#[test]
#[should_panic(expected = "Causality violation")]
fn without_their_fences_phases_end_too_early() {
    share_phases!(broken::phases::Phases);
}

/// Threads write to one place, each in its turn: loom refuses writes side by side.
#[test]
fn one_thread_has_the_turn() {
    model(|| {
        let turns = Arc::new(checked::turns::Turns::default());
        let used = Arc::new(UnsafeCell::new(0));
        let work = |turns: &checked::turns::Turns, used: &UnsafeCell<u32>| {
            let _turn = turns.take(thread::yield_now);
            // SAFETY: the turn is this thread's; loom checks it.
            #[allow(unsafe_code)]
            used.with_mut(|used| unsafe { *used += 1 });
        };
        let other = {
            let (turns, used) = (Arc::clone(&turns), Arc::clone(&used));
            thread::spawn(move || (0..2).for_each(|_| work(&turns, &used)))
        };
        work(&turns, &used);
        other.join().unwrap();
        // SAFETY: the other thread has ended.
        #[allow(unsafe_code)]
        let used = used.with(|used| unsafe { *used });
        assert_eq!(used, 3);
    });
}

/// A side sends a message while the other falls asleep. It is seen by the look that follows, or the sleeper is woken.
macro_rules! send_to_a_sleeper {
    ($($side:tt)+) => {
        model(|| {
            use $($side)+ as handshake;
            let words = Arc::new((AtomicU64::new(0), AtomicU64::new(0)));
            let sleeper = {
                let words = Arc::clone(&words);
                thread::spawn(move || {
                    let (sent, sleeps) = &*words;
                    handshake::fall_asleep(sleeps);
                    handshake::last(sent) == 1
                })
            };
            let (sent, sleeps) = &*words;
            handshake::announce(sent, 1);
            let is_woken = handshake::sleeps(sleeps);
            let has_seen = sleeper.join().unwrap();
            assert!(has_seen || is_woken, "a message that nobody reads");
        });
    };
}

#[test]
fn a_message_is_seen_or_wakes_who_fell_asleep() {
    send_to_a_sleeper!(checked::handshake);
}

#[test]
#[should_panic(expected = "a message that nobody reads")]
fn without_its_fences_a_message_is_missed() {
    send_to_a_sleeper!(broken::handshake);
}

/// A place is written to, read, let go of and written to again: loom refuses a read beside a write.
fn use_a_place_again(is_awaited: bool) {
    model(move || {
        let words = Arc::new((AtomicU64::new(0), AtomicU64::new(0)));
        let place = Arc::new(UnsafeCell::new(0));
        let reader = {
            let (words, place) = (Arc::clone(&words), Arc::clone(&place));
            thread::spawn(move || {
                let (sent, released) = &*words;
                let number = checked::handshake::last(sent);
                if number > 0 {
                    // SAFETY: what was announced is there until it is let go of; loom checks it.
                    #[allow(unsafe_code)]
                    let message = place.with(|place| unsafe { *place });
                    assert_eq!(message, number);
                    checked::handshake::release(released, number);
                }
            })
        };
        let (sent, released) = &*words;
        for number in 1..=2 {
            if number == 2 && is_awaited && checked::handshake::last(released) != 1 {
                break;
            }
            // SAFETY: the place is free; loom checks it.
            #[allow(unsafe_code)]
            place.with_mut(|place| unsafe { *place = number });
            checked::handshake::announce(sent, number);
        }
        reader.join().unwrap();
    });
}

#[test]
fn a_place_is_written_to_when_it_was_let_go_of() {
    use_a_place_again(true);
}

#[test]
#[should_panic(expected = "Causality violation")]
fn a_place_that_is_still_read_is_not_to_be_written_to() {
    use_a_place_again(false);
}
