//! From the list that comes down, in no order, to what is told: sorted by pair, begun and ended apart.
//!
//! A long list is taken by several threads, in two steps: each reads a part of it and deals its pairs into
//! buckets by their first numbers; then each sorts some buckets and writes them to their places.

use std::ops::Range;

use pairmask_core::scene::{EndReason, Ended, sort_row};
use pairmask_shaders::constants::{TOLD_BEGUN, TOLD_FILTERED, TOLD_REMOVED};
use rayon::iter::{
    IntoParallelIterator as _, IntoParallelRefMutIterator as _, ParallelIterator as _,
};

use super::Pair;

/// Pairs up to which a plain sort is sooner done.
const FEW_PAIRS: usize = 256;
/// Pairs from which several threads sort: to wake them and to wait takes 100 to 150 µs on a host of 16
/// cores, in which one thread sorts 14,000.
const MANY_PAIRS: usize = 20_000;
/// Fewest pairs of a part.
const PART_PAIRS: usize = 2 << 10;
/// Bits of a digit, at most: counters of 16 KiB stay in the nearest cache.
const DIGIT_BITS: u32 = 12;
/// Bits of the bucket into which a pair is dealt for several threads.
const BUCKET_BITS: u32 = 6;
/// Tasks of a thread: buckets are of several sizes.
const TASKS_A_THREAD: usize = 2;

/// Sorts what comes down. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct ChangeSorter {
    parts: Vec<Part>,
    scratch: Vec<Scratch>,
}

pub(super) struct Found<'a, R> {
    /// Copies pairs from a place of the list on.
    pub read: &'a R,
    pub count: usize,
    /// First numbers are below.
    pub n: u32,
}

/// A part of the list, dealt by bucket.
#[derive(Debug, Default)]
struct Part {
    range: Range<usize>,
    read: Vec<Pair>,
    dealt: Vec<Pair>,
    /// Of each bucket: the end in `dealt`, and how many pairs of it began.
    buckets: Vec<Dealt>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Dealt {
    end: u32,
    begun: u32,
}

#[derive(Debug, Default)]
struct Scratch {
    pairs: Vec<Pair>,
    other: Vec<Pair>,
    counts: Vec<u32>,
}

enum Places<'a> {
    Pairs(&'a mut [Pair]),
    Changes { begun: &'a mut [Pair], ended: &'a mut [Ended] },
}

struct Task<'a> {
    buckets: Range<usize>,
    places: Places<'a>,
    scratch: &'a mut Scratch,
}

impl ChangeSorter {
    pub fn allocated_bytes(&self) -> usize {
        let pairs = self.parts.iter().map(|part| part.read.capacity() + part.dealt.capacity());
        let more = self.scratch.iter().map(|of| of.pairs.capacity() + of.other.capacity());
        pairs.chain(more).sum::<usize>() * size_of::<Pair>()
    }

    /// Writes the pairs of a list, none of them twice, in order.
    pub fn pairs(
        &mut self,
        found: &Found<'_, impl Fn(usize, &mut [Pair]) + Sync>,
        threads: usize,
        pairs: &mut Vec<Pair>,
    ) {
        self.deal(found, threads);
        pairs.resize(found.count, [0; 2]);
        self.sort(found.n, threads, Places::Pairs(pairs));
    }

    /// Writes what began and what ended, each in order.
    pub fn changes(
        &mut self,
        found: &Found<'_, impl Fn(usize, &mut [Pair]) + Sync>,
        threads: usize,
        begun: &mut Vec<Pair>,
        ended: &mut Vec<Ended>,
    ) {
        self.deal(found, threads);
        let dealt = self.parts.iter().flat_map(|part| &part.buckets);
        let begun_count = dealt.map(|bucket| bucket.begun as usize).sum();
        begun.resize(begun_count, [0; 2]);
        let none = Ended { pair: [0; 2], reason: EndReason::Removed };
        ended.resize(found.count - begun_count, none);
        self.sort(found.n, threads, Places::Changes { begun, ended });
    }

    fn deal(&mut self, found: &Found<'_, impl Fn(usize, &mut [Pair]) + Sync>, threads: usize) {
        let &Found { read, count, n } = found;
        let (parts, shift) = if threads > 1 && count >= MANY_PAIRS {
            (
                (count / PART_PAIRS).min(threads * TASKS_A_THREAD),
                row_bits(n).saturating_sub(BUCKET_BITS),
            )
        } else {
            (1, row_bits(n))
        };
        self.parts.resize_with(parts, Part::default);
        for (at, part) in self.parts.iter_mut().enumerate() {
            part.range = count * at / parts..count * (at + 1) / parts;
        }
        let buckets = ((n.max(1) as usize - 1) >> shift) + 1;
        if let [part] = self.parts.as_mut_slice() {
            part.deal(read, buckets, shift);
        } else {
            self.parts.par_iter_mut().for_each(|part| part.deal(read, buckets, shift));
        }
    }

    fn sort(&mut self, n: u32, threads: usize, places: Places<'_>) {
        let Self { parts, scratch } = self;
        let buckets = parts.first().map_or(0, |part| part.buckets.len());
        let shift =
            if buckets == 1 { row_bits(n) } else { row_bits(n).saturating_sub(BUCKET_BITS) };
        let count: usize = parts.iter().map(|part| part.range.len()).sum();
        let tasks = buckets.min(threads * TASKS_A_THREAD).max(1);
        scratch.resize_with(scratch.len().max(tasks), Scratch::default);
        let parts = parts.as_slice();
        let mut work = Vec::with_capacity(tasks);
        let (mut rest, mut first, mut dealt) = (places, 0, 0);
        for (at, scratch) in scratch.iter_mut().take(tasks).enumerate() {
            let (start, share) = (first, count * (at + 1) / tasks);
            let (mut here, mut begun) = (0, 0);
            while first < buckets && (dealt + here < share || at + 1 == tasks) {
                here += parts.iter().map(|part| part.bucket(first).len()).sum::<usize>();
                begun += parts.iter().map(|part| part.buckets[first].begun as usize).sum::<usize>();
                first += 1;
            }
            dealt += here;
            let (places, later) = rest.split(here, begun);
            rest = later;
            work.push(Task { buckets: start..first, places, scratch });
        }
        if let [task] = work.as_mut_slice() {
            task.run(parts, shift);
        } else {
            work.into_par_iter().for_each(|mut task| task.run(parts, shift));
        }
    }
}

impl Part {
    fn deal(&mut self, read: &impl Fn(usize, &mut [Pair]), buckets: usize, shift: u32) {
        let len = self.range.len();
        self.buckets.clear();
        self.buckets.resize(buckets, Dealt::default());
        if buckets == 1 {
            let dealt = first(&mut self.dealt, len);
            read(self.range.start, dealt);
            let begun = dealt.iter().filter(|pair| has_begun(**pair)).count() as u32;
            self.buckets[0] = Dealt { end: len as u32, begun };
            return;
        }
        let (pairs, dealt) = (first(&mut self.read, len), first(&mut self.dealt, len));
        read(self.range.start, pairs);
        let last = buckets - 1;
        // What the device wrote is below `n`; were it not, it would lie in the last bucket.
        let bucket = |pair: &Pair| ((pair[0] >> shift) as usize).min(last);
        for pair in pairs.iter() {
            let bucket = &mut self.buckets[bucket(pair)];
            bucket.end += 1;
            bucket.begun += u32::from(has_begun(*pair));
        }
        let mut next = 0;
        for bucket in &mut self.buckets {
            next += std::mem::replace(&mut bucket.end, next);
        }
        for pair in pairs.iter() {
            let place = &mut self.buckets[bucket(pair)].end;
            dealt[*place as usize] = *pair;
            *place += 1;
        }
    }

    fn bucket(&self, bucket: usize) -> &[Pair] {
        let start = if bucket == 0 { 0 } else { self.buckets[bucket - 1].end };
        &self.dealt[start as usize..self.buckets[bucket].end as usize]
    }
}

impl Places<'_> {
    /// The places of the first `count` pairs, `begun` of which began, and all others.
    fn split(self, count: usize, begun: usize) -> (Self, Self) {
        match self {
            Self::Pairs(pairs) => {
                let (here, later) = pairs.split_at_mut(count);
                (Self::Pairs(here), Self::Pairs(later))
            }
            Self::Changes { begun: all_begun, ended } => {
                let (begun_here, begun_later) = all_begun.split_at_mut(begun);
                let (ended_here, ended_later) = ended.split_at_mut(count - begun);
                (
                    Self::Changes { begun: begun_here, ended: ended_here },
                    Self::Changes { begun: begun_later, ended: ended_later },
                )
            }
        }
    }

    /// Writes sorted pairs to the next places.
    fn write(&mut self, sorted: &[Pair]) {
        match self {
            Self::Pairs(pairs) => {
                let (here, later) = std::mem::take(pairs).split_at_mut(sorted.len());
                here.copy_from_slice(sorted);
                *pairs = later;
            }
            Self::Changes { begun, ended } => {
                let written = split_changes(sorted, begun, ended);
                *begun = &mut std::mem::take(begun)[written..];
                *ended = &mut std::mem::take(ended)[sorted.len() - written..];
            }
        }
    }
}

impl Task<'_> {
    fn run(&mut self, parts: &[Part], shift: u32) {
        let Scratch { pairs, other, counts } = &mut *self.scratch;
        for bucket in self.buckets.clone() {
            let len = parts.iter().map(|part| part.bucket(bucket).len()).sum();
            let pairs = first(pairs, len);
            let mut rest = &mut *pairs;
            for part in parts {
                let dealt = part.bucket(bucket);
                let (to, later) = rest.split_at_mut(dealt.len());
                to.copy_from_slice(dealt);
                rest = later;
            }
            if len <= FEW_PAIRS {
                pairs.sort_unstable();
            } else {
                sort_by_digits(pairs, first(other, len), counts, shift);
            }
            self.places.write(pairs);
        }
    }
}

/// Bits of numbers below `n`.
const fn row_bits(n: u32) -> u32 {
    u32::BITS - n.saturating_sub(1).leading_zeros()
}

/// The first `len` pairs of memory that only grows, whatever they hold.
fn first(memory: &mut Vec<Pair>, len: usize) -> &mut [Pair] {
    if memory.len() < len {
        memory.resize(len, [0; 2]);
    }
    &mut memory[..len]
}

/// Sorts by the low `bits` of the first number, the lowest digit first; all others are the same in all
/// pairs. Few pairs share a number: those are sorted where they lie.
fn sort_by_digits(pairs: &mut [Pair], other: &mut [Pair], counts: &mut Vec<u32>, bits: u32) {
    let digits = bits.div_ceil(DIGIT_BITS);
    let width = bits.div_ceil(digits.max(1));
    let values = 1usize << width;
    counts.clear();
    counts.resize(values * digits as usize, 0);
    let digit = |pair: &Pair, at: u32| (pair[0] >> (at * width)) as usize & (values - 1);
    for pair in pairs.iter() {
        for at in 0..digits {
            counts[values * at as usize + digit(pair, at)] += 1;
        }
    }
    let (mut from, mut to) = (&mut *pairs, other);
    for at in 0..digits {
        let counts = &mut counts[values * at as usize..][..values];
        let mut next = 0;
        for count in counts.iter_mut() {
            next += std::mem::replace(count, next);
        }
        for pair in from.iter() {
            let place = &mut counts[digit(pair, at)];
            to[*place as usize] = *pair;
            *place += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    if digits % 2 == 1 {
        to.copy_from_slice(from);
    }
    for row in pairs.chunk_by_mut(|a, b| a[0] == b[0]) {
        sort_row(row);
    }
}

const fn has_begun([_, reported]: Pair) -> bool {
    reported & 3 == TOLD_BEGUN
}

/// Writes changes to the next places of both lists. Returns how many began.
fn split_changes(sorted: &[Pair], begun: &mut [Pair], ended: &mut [Ended]) -> usize {
    // What a change is nobody guesses, a processor neither: each is written to the next place of both
    // lists, and one of them moves on. A list that is full takes no more.
    let (mut next_begun, mut next_ended) = (0, 0);
    for change in sorted {
        let &[a, other] = change;
        let pair = [a, other >> 2];
        let reason = match other & 3 {
            TOLD_REMOVED => EndReason::Removed,
            TOLD_FILTERED => EndReason::Filtered,
            _ => EndReason::Separated,
        };
        if let Some(place) = begun.get_mut(next_begun) {
            *place = pair;
        }
        if let Some(place) = ended.get_mut(next_ended) {
            *place = Ended { pair, reason };
        }
        let begins = usize::from(has_begun(*change));
        next_begun += begins;
        next_ended += 1 - begins;
    }
    next_begun
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Changes of pairs, each once, in an order of chance.
    fn changes(count: usize, n: u32) -> Vec<Pair> {
        let mut state = count as u64;
        let mut next = |bound: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as u32 % bound
        };
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
        let cases = [
            (0, 1),
            (1, 1),
            (70, 2),
            (257, 1),
            (300, 70),
            (5_000, 345),
            (5_000, 1 << 29),
            (70_000, 9_000),
        ];
        for (count, n) in cases {
            for threads in [1, 3] {
                let source = changes(count, n);
                let read =
                    |at: usize, to: &mut [Pair]| to.copy_from_slice(&source[at..at + to.len()]);
                let found = Found { read: &read, count: source.len(), n };
                let mut expected = source.clone();
                expected.sort_unstable();
                let mut list = vec![[7; 2]; 3];
                sorter.pairs(&found, threads, &mut list);
                assert!(list == expected, "{count} changes of {n} boxes, {threads} threads");
                let (mut begun, mut ended) = (vec![[7; 2]; 3], Vec::new());
                sorter.changes(&found, threads, &mut begun, &mut ended);
                let reported = |change: &&Pair| has_begun(**change);
                let plain = |change: &Pair| [change[0], change[1] >> 2];
                assert!(list.iter().filter(reported).map(plain).eq(begun), "{count} of {n}");
                let ends = list.iter().filter(|change| !has_begun(**change));
                let reasons = [TOLD_REMOVED, TOLD_FILTERED].into_iter();
                let reasons: Vec<(u32, EndReason)> =
                    reasons.zip([EndReason::Removed, EndReason::Filtered]).collect();
                let expected = ends.map(|change| {
                    let reason = reasons.iter().find(|(reported, _)| *reported == change[1] & 3);
                    let reason = reason.map_or(EndReason::Separated, |(_, reason)| *reason);
                    Ended { pair: plain(change), reason }
                });
                assert!(expected.eq(ended), "{count} of {n}");
            }
        }
    }
}
