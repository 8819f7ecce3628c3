//! Which cores lanes run on: none that serves the interrupts of a GPU, and none to which a client has bound a thread,
//! where the machine tells which those are. No rights are needed for it.
//!
//! Threads that may run anywhere are the scheduler's to keep apart, and it does. A bound thread it cannot move: it
//! waits until the lane on its core gives way.
//!
//! ```text
//! interrupts  cores that serve GPUs
//! bound       cores to which threads of clients are bound
//! mod         what is left to lanes, and how a lane takes it
//! ```

mod bound;
mod interrupts;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use self::bound::bound_cores;
use self::interrupts::serving_cores;

/// Of so many cores of lanes one may be left to interrupts: more is worth more to the lanes.
const CORES_A_SERVING_ONE: usize = 4;
/// Of so many cores of lanes one may be left to clients in all. As many lanes are awake as half of the cores.
const CORES_A_CLIENTS_ONE: usize = 2;

/// The cores of lanes.
#[derive(Debug, Default)]
pub(super) struct Placement {
    /// Those that this process may use; none where the system does not tell.
    mine: BTreeSet<usize>,
    /// Those of them that serve interrupts of GPUs.
    serving: Mutex<BTreeSet<usize>>,
    /// Those that are left to lanes.
    left: Mutex<BTreeSet<usize>>,
    /// Changes with `left`.
    changes: AtomicU32,
}

/// Where a lane has been placed.
#[derive(Debug)]
pub(super) struct Seat {
    /// Its cores; `None` once somebody else has placed it, or the system refused.
    cores: Option<CpuSet>,
    /// Of the placement that it follows.
    changes: u32,
}

impl Seat {
    /// Of the calling thread, which has not been placed.
    pub(super) fn of_this_thread() -> Self {
        Self { cores: sched_getaffinity(None).ok(), changes: 0 }
    }
}

impl Placement {
    /// For lanes of this process, beside no GPU.
    pub(super) fn of_this_process() -> Self {
        let Ok(allowed) = sched_getaffinity(None) else { return Self::default() };
        let mine: BTreeSet<usize> =
            (0..CpuSet::MAX_CPU).filter(|core| allowed.is_set(*core)).collect();
        Self { left: Mutex::new(mine.clone()), mine, ..Self::default() }
    }

    /// Leaves the cores to GPUs that serve their interrupts, by their PCI addresses.
    pub(super) fn put_beside(&self, gpus: &[String]) {
        let serving = serving_cores(Path::new("/"), gpus);
        let serving: BTreeSet<usize> = self.mine.intersection(&serving).copied().collect();
        if !serving.is_empty() {
            log::info!("cores that serve the interrupts of GPUs: {serving:?}");
        }
        *self.serving.lock().unwrap_or_else(PoisonError::into_inner) = serving;
        self.leave(&BTreeSet::new());
    }

    /// Looks to which cores these processes, clients, have bound threads.
    pub(super) fn look(&self, clients: &BTreeSet<u32>) {
        self.leave(&bound_cores(clients));
    }

    /// Leaves these cores to clients.
    fn leave(&self, bound: &BTreeSet<usize>) {
        let serving = self.serving.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let left = left_to_lanes(&self.mine, &serving, bound);
        let mut current = self.left.lock().unwrap_or_else(PoisonError::into_inner);
        if *current != left {
            log::debug!("lanes run on the cores {left:?}");
            *current = left;
            self.changes.fetch_add(1, Ordering::Release);
        }
    }

    /// Places the calling thread, whose seat this is, where the placement has changed. One that somebody else has
    /// placed meanwhile stays there for good.
    pub(super) fn take(&self, seat: &mut Seat) {
        let changes = self.changes.load(Ordering::Acquire);
        if seat.changes == changes {
            return;
        }
        seat.changes = changes;
        let Some(cores) = seat.cores else { return };
        let mut left = CpuSet::new();
        for core in &*self.left.lock().unwrap_or_else(PoisonError::into_inner) {
            left.set(*core);
        }
        let is_ours = sched_getaffinity(None).is_ok_and(|now| now == cores);
        // Refused where a core has gone since.
        let is_placed = is_ours && sched_setaffinity(None, &left).is_ok();
        seat.cores = is_placed.then_some(left);
        if !is_placed {
            log::debug!("a lane stays where it is");
        }
    }
}

/// The cores that are left to lanes of those that this process may use: none that serve interrupts, and none to which
/// clients are bound, where few enough are given up.
fn left_to_lanes(
    mine: &BTreeSet<usize>,
    serving: &BTreeSet<usize>,
    bound: &BTreeSet<usize>,
) -> BTreeSet<usize> {
    let without = |left: &BTreeSet<usize>, others: &BTreeSet<usize>, one_in: usize| {
        let rest: BTreeSet<usize> = left.difference(others).copied().collect();
        let is_worth_it = (mine.len() - rest.len()) * one_in <= mine.len();
        if is_worth_it { rest } else { left.clone() }
    };
    let left = without(mine, serving, CORES_A_SERVING_ONE);
    without(&left, bound, CORES_A_CLIENTS_ONE)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    fn set(cores: std::ops::Range<usize>) -> BTreeSet<usize> {
        cores.collect()
    }

    fn one_core_of_this_thread() -> (CpuSet, usize) {
        let allowed = sched_getaffinity(None).expect("this thread's cores");
        let first = (0..CpuSet::MAX_CPU).find(|core| allowed.is_set(*core)).expect("a core");
        (allowed, first)
    }

    #[test]
    fn lanes_give_up_few_cores_or_none() {
        let left = |mine, serving, bound| left_to_lanes(&set(mine), &set(serving), &set(bound));
        assert_eq!(left(0..16, 3..4, 0..0), &set(0..16) - &set(3..4));
        assert_eq!(left(0..4, 0..1, 0..0), set(1..4));
        assert_eq!(left(0..2, 0..1, 0..0), set(0..2), "half of them for interrupts");
        assert_eq!(left(0..16, 0..16, 0..0), set(0..16), "the machine does not tell");
        assert_eq!(left(0..16, 20..24, 30..31), set(0..16), "cores of others");
        assert_eq!(left(0..2, 0..0, 1..2), set(0..1));
        assert_eq!(left(0..16, 0..4, 8..12), &set(4..16) - &set(8..12));
        assert_eq!(left(0..16, 0..4, 8..13), set(4..16), "more than half in all");
        assert_eq!(left(0..1, 0..0, 0..1), set(0..1));
        assert_eq!(left(0..0, 0..1, 0..1), set(0..0));
    }

    #[test]
    fn a_lane_follows_the_placement_there_and_back() {
        let (allowed, first) = one_core_of_this_thread();
        if allowed.count() < 2 {
            return assert_eq!(allowed.count(), 1, "a machine with nowhere to go");
        }
        let placement = Placement::of_this_process();
        thread::spawn(move || {
            let mut seat = Seat::of_this_thread();
            placement.take(&mut seat);
            assert_eq!(sched_getaffinity(None).expect("cores"), allowed);
            placement.leave(&BTreeSet::from([first]));
            placement.take(&mut seat);
            let now = sched_getaffinity(None).expect("cores");
            assert!(!now.is_set(first) && now.count() == allowed.count() - 1);
            placement.leave(&BTreeSet::new());
            placement.take(&mut seat);
            assert_eq!(sched_getaffinity(None).expect("cores"), allowed);
        })
        .join()
        .expect("no panic");
    }

    #[test]
    fn a_lane_that_somebody_else_has_placed_stays_there() {
        let (allowed, first) = one_core_of_this_thread();
        let placement = Placement::of_this_process();
        thread::spawn(move || {
            let mut seat = Seat::of_this_thread();
            let mut one = CpuSet::new();
            one.set(first);
            sched_setaffinity(None, &one).expect("its own core");
            placement.leave(&BTreeSet::from([first]));
            placement.take(&mut seat);
            assert_eq!(sched_getaffinity(None).expect("cores"), one);
            placement.leave(&BTreeSet::new());
            placement.take(&mut seat);
            assert_eq!(sched_getaffinity(None).expect("cores"), one);
        })
        .join()
        .expect("no panic");
        assert_eq!(sched_getaffinity(None).expect("this thread's cores"), allowed);
    }
}
