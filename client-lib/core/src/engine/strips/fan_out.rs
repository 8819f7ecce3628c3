//! Work in parts on the calling thread's rayon pool, each part with storage of its own.
//!
//! Halving with `join` needs no list of jobs, so that a steady frame allocates nothing. Each part runs
//! with the default floating-point flags, whatever those of the thread that it falls to.

use crate::floats;

/// Parts a thread, so that a thread that is held up does not hold up the frame.
const PARTS_PER_THREAD: usize = 8;

/// Parts for work on `items` items of which a part should have `least` or more. At most `threads`
/// of them run at once.
pub(crate) fn part_count(items: usize, least: usize, threads: usize) -> usize {
    if threads <= 1 {
        return 1;
    }
    // A larger pool would run more parts at once than the job allows.
    let most =
        if rayon::current_num_threads() <= threads { threads * PARTS_PER_THREAD } else { threads };
    (items / least.max(1)).clamp(1, most)
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

/// Runs `run` on `parts` contiguous parts of the work and joins the results in their order. `join` is for
/// whole numbers: it runs with the flags of whichever thread it falls to.
pub(crate) fn in_parts<W: Split, R: Send>(
    work: W,
    parts: usize,
    run: &(impl Fn(W) -> R + Sync),
    join: &(impl Fn(R, R) -> R + Sync),
) -> R {
    if parts <= 1 || work.len() <= 1 {
        return floats::with_default(|| run(work));
    }
    let low_parts = parts / 2;
    let at = work.len() * low_parts / parts;
    let (low, high) = work.split_at(at);
    let (low, high) = rayon::join(
        || in_parts(low, low_parts, run, join),
        || in_parts(high, parts - low_parts, run, join),
    );
    join(low, high)
}

/// Calls `run` with each item of a slice, in so many parts.
pub(crate) fn for_each_in_parts<T: Send>(
    items: &mut [T],
    parts: usize,
    run: impl Fn(&mut T) + Sync,
) {
    in_parts(items, parts, &|items: &mut [T]| items.iter_mut().for_each(&run), &|(), ()| ());
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
                let mut items: Vec<usize> = (0..n).collect();
                let seen = in_parts(
                    items.as_mut_slice(),
                    parts,
                    &|part: &mut [usize]| part.to_vec(),
                    &appended,
                );
                assert_eq!(seen, items);
            }
        }
    }
}
