//! From the list that comes down, in no order, to what is told: sorted by pair, begun and ended apart.

use pairmask_core::scene::{EndReason, Ended, sort_row};
use pairmask_shaders::constants::{TOLD_BEGUN, TOLD_FILTERED, TOLD_REMOVED};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::Pair;

/// Pairs up to which a plain sort is sooner done.
const FEW_PAIRS: usize = 256;
/// Pairs from which several threads sort and split: it takes them some 10 µs to begin.
const MANY_PAIRS: usize = 48 << 10;
/// Bits of a digit, at most: counters of 16 KiB stay in the nearest cache.
const DIGIT_BITS: u32 = 12;
/// Pairs of a part that a thread deals or splits.
const PART_PAIRS: usize = 16 << 10;
/// Bits of the bucket into which a pair is dealt for the threads that sort.
const BUCKET_BITS: u32 = 6;

/// Sorts what comes down. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct ChangeSorter {
    other: Vec<Pair>,
    dealt: Vec<Pair>,
    counts: Vec<u32>,
}

/// The pairs of a part of the list, dealt by bucket, and where each bucket ends.
struct Deal<'a> {
    dealt: &'a [Pair],
    ends: [u32; 1 << BUCKET_BITS],
}

impl ChangeSorter {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        (self.other.capacity() + self.dealt.capacity()) * size_of::<Pair>()
            + self.counts.capacity() * size_of::<u32>()
    }

    /// Sorts pairs, none of them twice, whose first numbers are below `n`.
    pub fn sort(&mut self, pairs: &mut [Pair], n: u32, threads: usize) {
        let bits = u32::BITS - n.saturating_sub(1).leading_zeros();
        if pairs.len() <= FEW_PAIRS {
            pairs.sort_unstable();
            return;
        }
        self.other.clear();
        self.other.resize(pairs.len(), [0; 2]);
        if threads == 1 || pairs.len() < MANY_PAIRS || bits <= BUCKET_BITS {
            sort_by_digits(pairs, &mut self.other, &mut self.counts, bits);
        } else {
            self.dealt.clear();
            self.dealt.resize(pairs.len(), [0; 2]);
            sort_in_buckets(pairs, &mut self.dealt, &mut self.other, bits);
        }
    }
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

/// Deals pairs into buckets by the high bits of their first numbers, part by part, then sorts each bucket;
/// parts and buckets side by side.
fn sort_in_buckets(pairs: &mut [Pair], dealt: &mut [Pair], other: &mut [Pair], bits: u32) {
    let shift = bits - BUCKET_BITS;
    let parts: Vec<_> = pairs.chunks(PART_PAIRS).zip(dealt.chunks_mut(PART_PAIRS)).collect();
    let deals: Vec<Deal<'_>> =
        parts.into_par_iter().map(|(pairs, dealt)| Deal::of(pairs, dealt, shift)).collect();
    // All pairs are dealt, so that their former places take the sorted ones.
    let (mut rest, mut rest_other) = (pairs, other);
    let mut buckets = Vec::with_capacity(1 << BUCKET_BITS);
    for bucket in 0..1 << BUCKET_BITS {
        let count = deals.iter().map(|deal| deal.bucket(bucket).len()).sum();
        let (here, later) = std::mem::take(&mut rest).split_at_mut(count);
        rest = later;
        let (other, later) = std::mem::take(&mut rest_other).split_at_mut(count);
        rest_other = later;
        buckets.push((bucket, here, other));
    }
    buckets.into_par_iter().for_each(|(bucket, here, other)| {
        let mut place = &mut *here;
        for deal in &deals {
            let dealt = deal.bucket(bucket);
            let (to, later) = std::mem::take(&mut place).split_at_mut(dealt.len());
            to.copy_from_slice(dealt);
            place = later;
        }
        sort_by_digits(here, other, &mut Vec::new(), shift);
    });
}

impl<'a> Deal<'a> {
    fn of(pairs: &[Pair], dealt: &'a mut [Pair], shift: u32) -> Self {
        let bucket = |pair: &Pair| (pair[0] >> shift) as usize % (1 << BUCKET_BITS);
        let mut ends = [0u32; 1 << BUCKET_BITS];
        for pair in pairs {
            ends[bucket(pair)] += 1;
        }
        let mut next = 0;
        for end in &mut ends {
            next += std::mem::replace(end, next);
        }
        for pair in pairs {
            let place = &mut ends[bucket(pair)];
            dealt[*place as usize] = *pair;
            *place += 1;
        }
        Self { dealt, ends }
    }

    /// The pairs of a bucket.
    fn bucket(&self, bucket: usize) -> &[Pair] {
        let start = if bucket == 0 { 0 } else { self.ends[bucket - 1] };
        &self.dealt[start as usize..self.ends[bucket] as usize]
    }
}

/// Splits sorted changes into those that began and those that ended.
pub(super) fn split(list: &[Pair], begun: &mut Vec<Pair>, ended: &mut Vec<Ended>, threads: usize) {
    let parts: Vec<&[Pair]> = if list.len() < MANY_PAIRS || threads == 1 {
        vec![list]
    } else {
        list.chunks(PART_PAIRS).collect()
    };
    let begun_count = |part: &[Pair]| part.iter().filter(|pair| has_begun(**pair)).count();
    let counts: Vec<usize> = if parts.len() == 1 {
        vec![begun_count(list)]
    } else {
        parts.clone().into_par_iter().map(begun_count).collect()
    };
    let all: usize = counts.iter().sum();
    begun.resize(all, [0; 2]);
    ended.resize(list.len() - all, Ended { pair: [0; 2], reason: EndReason::Removed });
    let (mut rest_begun, mut rest_ended) = (begun.as_mut_slice(), ended.as_mut_slice());
    let mut work = Vec::with_capacity(parts.len());
    for (part, count) in parts.into_iter().zip(counts) {
        let (begun, later) = std::mem::take(&mut rest_begun).split_at_mut(count);
        rest_begun = later;
        let (ended, later) = std::mem::take(&mut rest_ended).split_at_mut(part.len() - count);
        rest_ended = later;
        work.push((part, begun, ended));
    }
    if let [(part, begun, ended)] = work.as_mut_slice() {
        split_part(part, begun, ended);
    } else {
        work.into_par_iter().for_each(|(part, begun, ended)| split_part(part, begun, ended));
    }
}

const fn has_begun([_, told]: Pair) -> bool {
    told & 3 == TOLD_BEGUN
}

/// Writes a part to its places, which are as many as it has of each.
fn split_part(part: &[Pair], begun: &mut [Pair], ended: &mut [Ended]) {
    // What a change is nobody guesses, a processor neither: each is written to the next place of both
    // lists, and one of them moves on. A list that is full takes no more.
    let (mut next_begun, mut next_ended) = (0, 0);
    for change in part {
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
                let mut list = changes(count, n);
                let mut expected = list.clone();
                expected.sort_unstable();
                sorter.sort(&mut list, n, threads);
                assert!(list == expected, "{count} changes of {n} boxes, {threads} threads");
                let (mut begun, mut ended) = (vec![[7; 2]; 3], Vec::new());
                split(&list, &mut begun, &mut ended, threads);
                let told = |change: &&Pair| has_begun(**change);
                let plain = |change: &Pair| [change[0], change[1] >> 2];
                assert!(list.iter().filter(told).map(plain).eq(begun), "{count} of {n}");
                let ends = list.iter().filter(|change| !has_begun(**change));
                let reasons = [TOLD_REMOVED, TOLD_FILTERED].into_iter();
                let reasons: Vec<(u32, EndReason)> =
                    reasons.zip([EndReason::Removed, EndReason::Filtered]).collect();
                let expected = ends.map(|change| {
                    let reason = reasons.iter().find(|(told, _)| *told == change[1] & 3);
                    let reason = reason.map_or(EndReason::Separated, |(_, reason)| *reason);
                    Ended { pair: plain(change), reason }
                });
                assert!(expected.eq(ended), "{count} of {n}");
            }
        }
    }
}
