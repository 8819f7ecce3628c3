//! From the list that comes down, in no order, to what is reported: sorted by pair, begun and ended apart.

use pairmask_core::cancel::Cancel;
use pairmask_core::scene::{EndReason, Ended, PairSorter};
use pairmask_shaders::constants::{REPORT_BEGUN, REPORT_FILTERED, REPORT_REMOVED};
use rayon::iter::{IndexedParallelIterator as _, IntoParallelIterator as _, ParallelIterator as _};
use rayon::slice::ParallelSliceMut as _;

use super::Pair;

/// Pairs from which several threads sort: to wake them and to wait takes 100 to 150 µs on a host of 16
/// cores, in which one thread sorts 14,000.
const MANY_PAIRS: usize = 20_000;
const READ_PAIRS: usize = 16 << 10;

/// Sorts what comes down. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct ChangeSorter {
    read: Vec<Pair>,
    sorted: Vec<Pair>,
    sorter: PairSorter,
}

pub(super) struct Found<'a, R> {
    /// Copies pairs from a place of the list on.
    pub read: &'a R,
    pub count: usize,
    /// First numbers are below.
    pub n: u32,
    /// With one, no pool is touched.
    pub threads: usize,
}

impl ChangeSorter {
    pub fn allocated_bytes(&self) -> usize {
        (self.read.capacity() + self.sorted.capacity()) * size_of::<Pair>()
            + self.sorter.allocated_bytes()
    }

    /// Writes the pairs of a list, none of them twice, in order.
    pub fn pairs(
        &mut self,
        found: &Found<'_, impl Fn(usize, &mut [Pair]) + Sync>,
        pairs: &mut Vec<Pair>,
    ) {
        let &Found { read, count, n, threads } = found;
        self.read.resize(count.max(self.read.len()), [0; 2]);
        let all = &mut self.read[..count];
        let threads = if count < MANY_PAIRS { 1 } else { threads };
        if threads == 1 {
            read(0, all);
        } else {
            let parts = all.par_chunks_mut(READ_PAIRS).enumerate();
            parts.for_each(|(at, part)| read(at * READ_PAIRS, part));
        }
        // What the device wrote is below `n`; were it not, it is nothing.
        self.sorter.sorted_from(all, &|pair| pair[0] < n, n, threads, &Cancel::never(), pairs);
    }

    pub fn changes(
        &mut self,
        found: &Found<'_, impl Fn(usize, &mut [Pair]) + Sync>,
        begun: &mut Vec<Pair>,
        ended: &mut Vec<Ended>,
    ) {
        let mut sorted = std::mem::take(&mut self.sorted);
        self.pairs(found, &mut sorted);
        let parts = if sorted.len() < MANY_PAIRS { 1 } else { found.threads };
        let part = sorted.len().div_ceil(parts).max(1);
        let count = |part: &[Pair]| part.iter().filter(|pair| has_begun(**pair)).count();
        let counts: Vec<usize> = sorted.chunks(part).map(count).collect();
        begun.resize(counts.iter().sum(), [0; 2]);
        let none = Ended { pair: [0; 2], reason: EndReason::Removed };
        ended.resize(sorted.len() - begun.len(), none);
        let (mut begun, mut ended) = (begun.as_mut_slice(), ended.as_mut_slice());
        let mut work = Vec::with_capacity(parts);
        for (these, count) in sorted.chunks(part).zip(counts) {
            let (begun_here, later) = std::mem::take(&mut begun).split_at_mut(count);
            begun = later;
            let (ended_here, later) = std::mem::take(&mut ended).split_at_mut(these.len() - count);
            ended = later;
            work.push((these, begun_here, ended_here));
        }
        if parts == 1 {
            for (these, begun, ended) in work {
                split_changes(these, begun, ended);
            }
        } else {
            let work = work.into_par_iter();
            work.for_each(|(these, begun, ended)| split_changes(these, begun, ended));
        }
        self.sorted = sorted;
    }
}

const fn has_begun([_, reported]: Pair) -> bool {
    reported & 3 == REPORT_BEGUN
}

/// Writes changes to both lists, which have room for exactly them.
fn split_changes(sorted: &[Pair], begun: &mut [Pair], ended: &mut [Ended]) {
    // What a change is nobody guesses, a processor neither: each is written to the next place of both
    // lists, and one of them moves on. A list that is full takes no more.
    let (mut next_begun, mut next_ended) = (0, 0);
    for change in sorted {
        let &[a, other] = change;
        let pair = [a, other >> 2];
        let reason = match other & 3 {
            REPORT_REMOVED => EndReason::Removed,
            REPORT_FILTERED => EndReason::Filtered,
            _ => EndReason::Separated,
        };
        if let Some(put) = begun.get_mut(next_begun) {
            *put = pair;
        }
        if let Some(put) = ended.get_mut(next_ended) {
            *put = Ended { pair, reason };
        }
        let begins = usize::from(has_begun(*change));
        next_begun += begins;
        next_ended += 1 - begins;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Random;

    /// Changes of pairs, each once, in an order of chance.
    fn changes(count: usize, n: u32) -> Vec<Pair> {
        let mut random = Random::new(count as u64);
        let mut next = |bound: u32| random.below(bound.into()) as u32;
        let mut all: Vec<Pair> = (0..count).map(|_| [next(n), next(n) << 2 | next(4)]).collect();
        all.sort_unstable();
        all.dedup();
        all.sort_by_key(|pair| {
            (u64::from(pair[0]) << 32 | u64::from(pair[1])).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        all
    }

    #[test]
    fn lists_of_every_length_are_sorted_and_split() {
        let mut sorter = ChangeSorter::default();
        for (count, n) in [(0, 1), (1, 1), (70, 2), (300, 70), (5_000, 1 << 29), (70_000, 9_000)] {
            for threads in [1, 3] {
                let source = changes(count, n);
                let read =
                    |at: usize, to: &mut [Pair]| to.copy_from_slice(&source[at..at + to.len()]);
                let found = Found { read: &read, count: source.len(), n, threads };
                let mut expected = source.clone();
                expected.sort_unstable();
                let mut list = vec![[7; 2]; 3];
                sorter.pairs(&found, &mut list);
                assert!(list == expected, "{count} changes of {n} boxes, {threads} threads");
                let (mut begun, mut ended) = (vec![[7; 2]; 3], Vec::new());
                sorter.changes(&found, &mut begun, &mut ended);
                let reported = |change: &&Pair| has_begun(**change);
                let plain = |change: &Pair| [change[0], change[1] >> 2];
                assert!(list.iter().filter(reported).map(plain).eq(begun), "{count} of {n}");
                let ends = list.iter().filter(|change| !has_begun(**change));
                let expected = ends.map(|change| {
                    let reported = |reported: u32| change[1] & 3 == reported;
                    let reason = if reported(REPORT_REMOVED) {
                        EndReason::Removed
                    } else {
                        EndReason::Separated
                    };
                    let reason =
                        if reported(REPORT_FILTERED) { EndReason::Filtered } else { reason };
                    Ended { pair: plain(change), reason }
                });
                assert!(expected.eq(ended), "{count} of {n}");
            }
        }
    }
}
