//! Lists of pairs in order, and what began and ended.
//!
//! Large lists are dealt into buckets of rows, task by task, and each bucket is sorted by counting:
//! two passes over memory, regardless of the number of pairs.

use crate::cancel::{Cancel, Pace};
use crate::engine::RecentNeed;
use crate::team::{self, for_each_in_parts, in_parts, part_count};

/// A pair of box indices, the lower one first.
pub(super) type Pair = [u32; 2];

pub(super) const PAIR_BYTES: u64 = size_of::<Pair>() as u64;

/// The pair of two boxes.
#[inline]
pub(super) fn pair(a: u32, b: u32) -> Pair {
    [a.min(b), a.max(b)]
}

/// One number that orders as the pair does.
#[inline(always)]
fn key([a, b]: Pair) -> u64 {
    u64::from(a) << 32 | u64::from(b)
}

/// Turns counts into where each of them begins; where the last one ends.
pub(super) fn starts_of(counts: &mut [u32]) -> u32 {
    let mut next = 0;
    for count in counts {
        next += std::mem::replace(count, next);
    }
    next
}

/// Pairs up to which a plain sort is sooner done.
const FEW_PAIRS: usize = 256;
/// Most buckets of a list: so many streams of writes stay in the caches of a core.
const BUCKETS_MOST: usize = 1 << 10;
/// Pairs of a bucket, on average, in a list that needs fewer buckets.
const BUCKET_PAIRS: usize = 4;
/// A bucket with fewer pairs than a row in so many has one is sorted by comparing: to count by rows would
/// take as long as there are rows.
const SPARSE_ROWS: usize = 4;
const TASK_PAIRS: usize = 16_384;
/// Pairs that are dealt between two looks whether anybody waits for them: some 100 µs.
const DEALT_AT_ONCE: usize = 1 << 15;
/// A pair that is compared with one of another list, in tests of boxes.
const PAIR_TESTS: u64 = 8;
/// Pairs of a row from which it is not sorted by insertion.
const LONG_ROW: usize = 24;

/// Scratch memory of sorting.
#[derive(Debug, Default)]
pub struct Sorter {
    dealt: Vec<Pair>,
    need: RecentNeed,
}

/// One task's pairs in, and its place for them by bucket.
struct Deal<'a> {
    pairs: &'a [Pair],
    dealt: &'a mut [Pair],
    /// End of each bucket in `dealt`; before that, its pairs.
    ends: Vec<u32>,
}

/// Some buckets of all tasks, and the place for exactly their pairs.
struct Gather<'a> {
    first: usize,
    count: usize,
    sorted: &'a mut [Pair],
}

impl Sorter {
    /// Bytes that are kept from one list to the next.
    pub fn allocated_bytes(&self) -> usize {
        self.dealt.capacity() * size_of::<Pair>()
    }

    /// Gives the memory back.
    pub fn give_back(&mut self) {
        self.dealt = Vec::new();
    }

    /// Sorts pairs whose first indices are below `n`, unless cancelled: then some are lost.
    pub fn sort(&mut self, pairs: &mut Vec<Pair>, n: u32, threads: usize, cancel: &Cancel) {
        if pairs.len() <= FEW_PAIRS {
            pairs.sort_unstable_by_key(|pair| key(*pair));
            return;
        }
        let source = std::mem::take(pairs);
        self.sorted_from(&source, &|_| true, n, threads, cancel, pairs);
    }

    /// Those of `source` that are needed, in order, unless cancelled. First indices of those are below `n`.
    pub fn sorted_from(
        &mut self,
        source: &[Pair],
        requested: &(impl Fn(Pair) -> bool + Sync),
        n: u32,
        threads: usize,
        cancel: &Cancel,
        sorted: &mut Vec<Pair>,
    ) {
        sorted.clear();
        if source.len() <= FEW_PAIRS {
            sorted.extend(source.iter().copied().filter(|pair| requested(*pair)));
            sorted.sort_unstable_by_key(|pair| key(*pair));
            return;
        }
        let _team = team::enter(threads);
        let most = (source.len() / BUCKET_PAIRS).next_power_of_two().min(BUCKETS_MOST) as u32;
        let shift = (n.max(1).next_power_of_two() / most).max(1).trailing_zeros();
        let buckets = (n >> shift) as usize + 1;
        let parts = part_count(source.len(), TASK_PAIRS, threads).min(threads * 2).max(1);
        let step = source.len().div_ceil(parts);
        let held_bytes = self.allocated_bytes();
        if self.need.note(size_of_val(source), || held_bytes) {
            self.give_back();
        }
        self.dealt.resize(source.len().max(self.dealt.len()), [0; 2]);
        let (ins, outs) = (source.chunks(step), self.dealt.chunks_mut(step));
        let mut deals: Vec<Deal<'_>> = ins
            .zip(outs)
            .map(|(pairs, dealt)| Deal { pairs, dealt, ends: vec![0; buckets] })
            .collect();
        for_each_in_parts(&mut deals, parts, |deal| deal.run(shift, requested, cancel));
        if cancel.is_cancelled() {
            return;
        }

        let deals = deals.as_slice();
        let total: usize = deals.iter().map(|deal| deal.ends[buckets - 1] as usize).sum();
        sorted.resize(total, [0; 2]);
        let mut gathers = Vec::with_capacity(buckets);
        let mut rest = sorted.as_mut_slice();
        let group = buckets.div_ceil(if parts == 1 { 1 } else { parts * 8 });
        for first in (0..buckets).step_by(group) {
            let count = group.min(buckets - first);
            let here = deals.iter().map(|deal| deal.range(first, count).len()).sum();
            let (sorted, later) = std::mem::take(&mut rest).split_at_mut(here);
            gathers.push(Gather { first, count, sorted });
            rest = later;
        }
        let gather = |gathers: &mut [Gather<'_>]| {
            let mut starts = Vec::new();
            for gather in gathers {
                if cancel.look() {
                    return;
                }
                gather.run(deals, shift, &mut starts);
            }
        };
        let parts = gathers.len();
        in_parts(gathers.as_mut_slice(), parts, &gather, &|(), ()| ());
    }
}

impl Deal<'_> {
    fn run(&mut self, shift: u32, requested: &impl Fn(Pair) -> bool, cancel: &Cancel) {
        for some in self.pairs.chunks(DEALT_AT_ONCE) {
            if self.pairs.len() > DEALT_AT_ONCE && cancel.look() {
                return;
            }
            for pair in some.iter().filter(|pair| requested(**pair)) {
                self.ends[(pair[0] >> shift) as usize] += 1;
            }
        }
        starts_of(&mut self.ends);
        for some in self.pairs.chunks(DEALT_AT_ONCE) {
            if self.pairs.len() > DEALT_AT_ONCE && cancel.look() {
                return;
            }
            for pair in some.iter().filter(|pair| requested(**pair)) {
                let next = &mut self.ends[(pair[0] >> shift) as usize];
                self.dealt[*next as usize] = *pair;
                *next += 1;
            }
        }
    }

    fn range(&self, first: usize, count: usize) -> &[Pair] {
        let start = if first == 0 { 0 } else { self.ends[first - 1] };
        &self.dealt[start as usize..self.ends[first + count - 1] as usize]
    }
}

impl Gather<'_> {
    fn run(&mut self, deals: &[Deal<'_>], shift: u32, starts: &mut Vec<u32>) {
        let mut rest = std::mem::take(&mut self.sorted);
        for bucket in self.first..self.first + self.count {
            let here = deals.iter().map(|deal| deal.range(bucket, 1).len()).sum();
            let (sorted, later) = rest.split_at_mut(here);
            rest = later;
            let first_row = (bucket as u32) << shift;
            let pairs = || deals.iter().flat_map(|deal| deal.range(bucket, 1));
            if here < (1 << shift) / SPARSE_ROWS {
                sorted.iter_mut().zip(pairs()).for_each(|(to, pair)| *to = *pair);
                sorted.sort_unstable_by_key(|pair| key(*pair));
                continue;
            }
            starts.clear();
            starts.resize((1 << shift) + 1, 0);
            for pair in pairs() {
                starts[(pair[0] - first_row) as usize] += 1;
            }
            starts_of(starts);
            for pair in pairs() {
                let next = &mut starts[(pair[0] - first_row) as usize];
                sorted[*next as usize] = *pair;
                *next += 1;
            }
            let mut start = 0;
            for end in starts.iter().map(|end| *end as usize) {
                sort_row(&mut sorted[start..end]);
                start = end;
            }
        }
    }
}

/// Sorts the pairs of one row by their second index.
#[inline]
pub fn sort_row(row: &mut [[u32; 2]]) {
    if row.len() > LONG_ROW {
        row.sort_unstable_by_key(|pair| pair[1]);
        return;
    }
    match row {
        [] | [_] => {}
        [a, b] => [a[1], b[1]] = [a[1].min(b[1]), a[1].max(b[1])],
        _ if row.len() <= 8 => sort_by_rank::<8>(row),
        _ if row.len() <= 16 => sort_by_rank::<16>(row),
        _ => sort_by_rank::<LONG_ROW>(row),
    }
}

/// Sorts a row of at most `LANES` pairs: how many others are less says where each one goes, without a branch on
/// what they are.
#[inline(always)]
fn sort_by_rank<const LANES: usize>(row: &mut [Pair]) {
    let mut columns = [i32::MAX; LANES];
    for (column, pair) in columns.iter_mut().zip(&*row) {
        // With the sign bit turned they compare as signed numbers, which every processor does.
        *column = (pair[1] ^ (1 << 31)) as i32;
    }
    let mut filled = 0u32;
    for i in 0..row.len().min(LANES) {
        let this = columns[i];
        let rank: i32 = columns.iter().map(|other| i32::from(*other < this)).sum();
        row[rank as usize][1] = (this ^ i32::MIN) as u32;
        filled |= 1 << rank;
    }
    // Of equal ones, all went to the place of the first: the places behind it are theirs.
    if filled.count_ones() as usize != row.len() {
        for i in 1..row.len() {
            if filled >> i & 1 == 0 {
                row[i][1] = row[i - 1][1];
            }
        }
    }
}

/// What began and what ended.
#[derive(Debug, Default)]
pub(super) struct Difference {
    /// Pairs that there are and were not, or that are others.
    pub begun: Vec<Pair>,
    /// Pairs that there were and are not, or that were others.
    pub ended: Vec<Pair>,
}

impl Difference {
    pub fn with(mut self, mut other: Self) -> Self {
        self.begun.append(&mut other.begun);
        self.ended.append(&mut other.ended);
        self
    }

    /// Sorts the pairs of `n` boxes and takes out those that are there twice.
    pub fn sort(&mut self, sorter: &mut Sorter, n: usize, threads: usize, cancel: &Cancel) {
        for list in [&mut self.begun, &mut self.ended] {
            sorter.sort(list, n as u32, threads, cancel);
            list.dedup();
        }
    }

    /// What differs between two sorted lists, sorted; and what both hold of pairs that are others now.
    pub fn between(
        then: &[Pair],
        now: &[Pair],
        is_another: &(impl Fn(Pair) -> bool + Sync),
        threads: usize,
        cancel: &Cancel,
    ) -> Self {
        let parts = part_count(now.len(), TASK_PAIRS, threads);
        let mut work = Vec::with_capacity(parts);
        let (mut rest_then, mut rest_now) = (then, now);
        for part in 1..parts {
            let at = now.len() * part / parts - (now.len() - rest_now.len());
            let border = key(rest_now[at]);
            let (first, later) = rest_now.split_at(at);
            let was = rest_then.partition_point(|pair| key(*pair) < border);
            work.push((&rest_then[..was], first));
            (rest_then, rest_now) = (&rest_then[was..], later);
        }
        work.push((rest_then, rest_now));
        let run = |work: &mut [(&[Pair], &[Pair])]| {
            let mut found = Self::default();
            for (then, now) in work {
                found.add(then, now, is_another, cancel);
            }
            found
        };
        in_parts(work.as_mut_slice(), parts, &run, &Self::with)
    }

    fn add(
        &mut self,
        then: &[Pair],
        now: &[Pair],
        is_another: &impl Fn(Pair) -> bool,
        cancel: &Cancel,
    ) {
        let (mut was, mut is, mut pace) = (0, 0, Pace::default());
        while was < then.len() && is < now.len() {
            if cancel.look_after(PAIR_TESTS, &mut pace) {
                return;
            }
            let (before, here) = (then[was], now[is]);
            let (ends, begins) = (key(before) <= key(here), key(here) <= key(before));
            (was, is) = (was + usize::from(ends), is + usize::from(begins));
            if ends != begins || is_another(here) {
                self.ended.extend(ends.then_some(before));
                self.begun.extend(begins.then_some(here));
            }
        }
        self.ended.extend_from_slice(&then[was..]);
        self.begun.extend_from_slice(&now[is..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn pairs(seed: u64, count: usize, n: u32) -> Vec<Pair> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as u32 % n
        };
        let some = (0..count).map(|_| (next(), next())).filter(|(a, b)| a != b);
        let set: BTreeSet<Pair> = some.map(|(a, b)| pair(a, b)).collect();
        let mut all: Vec<Pair> = set.into_iter().collect();
        // Not in order: by a number that has nothing to do with it.
        all.sort_by_key(|pair| key(*pair).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        all
    }

    proptest! {
        #[test]
        fn rows_are_sorted_and_keep_what_they_hold_twice(
            columns in prop::collection::vec(prop_oneof![0u32..8, any::<u32>()], 0..2 * LONG_ROW),
        ) {
            let mut row: Vec<Pair> = columns.iter().map(|column| [3, *column]).collect();
            let mut sorted = row.clone();
            sorted.sort_unstable();
            sort_row(&mut row);
            prop_assert_eq!(row, sorted);
        }
    }

    #[test]
    fn lists_of_every_length_are_sorted_on_every_number_of_threads() {
        for (count, n) in [
            (0, 2),
            (5, 3),
            (2_000, 70),
            (5_000, 345),
            (70_000, 1_234),
            (90_000, 200_000),
            (300, 1 << 30),
            (4_000, 1_000_000),
            (40_000, 10_000_000),
        ] {
            let source = pairs(count as u64, count, n);
            let mut expected: Vec<Pair> =
                source.iter().copied().filter(|pair| pair[1] % 3 != 0).collect();
            expected.sort_unstable();
            for threads in [1, 2, 3] {
                let mut sorted = Vec::new();
                let requested = |pair: Pair| !pair[1].is_multiple_of(3);
                Sorter::default().sorted_from(
                    &source,
                    &requested,
                    n,
                    threads,
                    &Cancel::never(),
                    &mut sorted,
                );
                assert_eq!(sorted, expected, "{count} pairs of {n} boxes, {threads} threads");
            }
        }
    }

    proptest! {
        #[test]
        fn lists_differ_by_what_one_has_and_by_what_is_another(
            seed in any::<u64>(),
            n in prop_oneof![2u32..60, 200u32..400],
            counts in [0usize..500, 0usize..60_000],
        ) {
            let [mut then, mut now] =
                [(seed, counts[0]), (!seed, counts[1])].map(|(seed, count)| pairs(seed, count, n));
            then.sort_unstable();
            now.sort_unstable();
            let is_another = |pair: Pair| pair[0].is_multiple_of(7);
            let without = |these: &[Pair], others: &[Pair]| -> Vec<Pair> {
                let differs =
                    |pair: &&Pair| is_another(**pair) || others.binary_search(pair).is_err();
                these.iter().filter(differs).copied().collect()
            };
            let (begun, ended) = (without(&now, &then), without(&then, &now));
            for threads in [1, 3] {
                let found = Difference::between(&then, &now, &is_another, threads, &Cancel::never());
                prop_assert!(found.begun == begun && found.ended == ended);
                let back = Difference::between(&now, &then, &is_another, threads, &Cancel::never());
                prop_assert!(back.begun == ended && back.ended == begun);
            }
        }
    }
}
