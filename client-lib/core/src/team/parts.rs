//! Work in parts, which the threads of a frame's [team](crate::team) take in turns, each part with storage of its own.
//!
//! Parts lie on the stack, so that a steady frame allocates nothing. Each runs with the default floating-point flags,
//! regardless of those of the thread that it falls to.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::{floats, team};

/// Parts a thread, so that a thread that is held up does not hold up the frame.
const PARTS_PER_THREAD: usize = 4;

/// The most parts of a phase: they have places on the stack.
const MOST_PARTS: usize = 128;

/// Parts for work on `entries` items of which a part should have `least` or more.
pub(crate) fn part_count(entries: usize, least: usize, threads: usize) -> usize {
    if threads <= 1 {
        return 1;
    }
    (entries / least.max(1)).clamp(1, (threads * PARTS_PER_THREAD).min(MOST_PARTS))
}

/// Work on a sequence of items that can be cut between any two of them.
pub(crate) trait Split: Sized + Send {
    fn len(&self) -> usize;
    /// The first `at` items, and the rest.
    fn split_at(self, at: usize) -> (Self, Self);
}

impl<T: Send> Split for &mut [T] {
    fn len(&self) -> usize {
        <[T]>::len(self)
    }

    fn split_at(self, at: usize) -> (Self, Self) {
        self.split_at_mut(at)
    }
}

/// A part, before and after it was run.
enum Part<W, R> {
    None,
    Work(W),
    Done(R),
}

/// Runs `run` on `parts` contiguous parts of the work and joins the results in their order. `join` is for
/// whole numbers: it runs with the flags of the calling thread.
pub(crate) fn in_parts<W: Split, R: Send>(
    work: W,
    parts: usize,
    run: &(impl Fn(W) -> R + Sync),
    join: &(impl Fn(R, R) -> R + Sync),
) -> R {
    let (len, parts) = (work.len(), parts.min(MOST_PARTS).min(work.len()));
    if parts <= 1 {
        return floats::with_default(|| run(work));
    }
    let mut slots = [const { Mutex::new(Part::None) }; MOST_PARTS];
    let (mut rest, mut before) = (work, 0);
    for (part, slot) in (1..parts).zip(&mut slots) {
        let end = len * part / parts;
        let (first, others) = rest.split_at(end - before);
        *slot = Mutex::new(Part::Work(first));
        (rest, before) = (others, end);
    }
    slots[parts - 1] = Mutex::new(Part::Work(rest));
    let next = AtomicUsize::new(0);
    let slots = &slots[..parts];
    team::share(&|| {
        while let Some(slot) = slots.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
            if let Part::Work(work) = std::mem::replace(&mut *slot, Part::None) {
                *slot = Part::Done(floats::with_default(|| run(work)));
            }
        }
    });
    let done = slots.iter().map(|slot| {
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        match std::mem::replace(&mut *slot, Part::None) {
            Part::Done(result) => result,
            // `share` returns when all parts are done, and panics where one panicked.
            Part::None | Part::Work(_) => unreachable!("a part was not done"),
        }
    });
    done.reduce(join).unwrap_or_else(|| unreachable!("there are two parts at least"))
}

/// Calls `run` with each item of a slice, in so many parts.
pub(crate) fn for_each_in_parts<T: Send>(
    entries: &mut [T],
    parts: usize,
    run: impl Fn(&mut T) + Sync,
) {
    in_parts(entries, parts, &|entries: &mut [T]| entries.iter_mut().for_each(&run), &|(), ()| ());
}

/// Calls `run` with stretches of two slices of one length, of which a part should have `least` items or more.
pub(crate) fn zip_in_parts<T: Send, U: Sync>(
    out: &mut [T],
    of: &[U],
    least: usize,
    threads: usize,
    run: impl Fn(&mut [T], &[U]) + Sync,
) {
    let parts = part_count(out.len(), least, threads);
    let step = out.len().div_ceil(parts).max(1);
    let mut work: Vec<_> = out.chunks_mut(step).zip(of.chunks(step)).collect();
    for_each_in_parts(&mut work, parts, |(out, of)| run(out, of));
}

/// The end of one list, then the other: how parts join what they have found.
pub(crate) fn appended<T>(mut low: Vec<T>, mut high: Vec<T>) -> Vec<T> {
    low.append(&mut high);
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_seen_once_and_results_keep_their_order() {
        for n in [0, 1, 2, 7, 100] {
            for parts in [1, 2, 3, 8, 200] {
                let mut entries: Vec<usize> = (0..n).collect();
                let seen = in_parts(
                    entries.as_mut_slice(),
                    parts,
                    &|part: &mut [usize]| part.to_vec(),
                    &appended,
                );
                assert_eq!(seen, entries);
            }
        }
    }
}
