//! Boxes by their min key on the sweep axis, ties by index.
//!
//! The order of the last frame is where this frame starts: boxes that moved a little are a few
//! places off, and insertion puts them right (Cohen et al. 1995, the persistent method that the
//! papers name). Where that takes too long, a sort starts afresh: few boxes are dealt into buckets by
//! coordinate and put right by insertion; many, and those that are spread unevenly, have a radix sort. The
//! result is the same: no two entries are equal, so there is one sorted order.

// `&` instead of `&&`: a branch would keep the search for bounds from being compiled to SIMD.
#![allow(clippy::needless_bitwise_bool)]

use crate::aabb::{coordinate, order_key};
use crate::cancel::Cancel;
use crate::engine::CullError;

/// Min key (in the upper half) and index of a box. Sorts as a number.
type Entry = u64;

/// Places that insertion may move an entry on average before the radix sort is cheaper.
const MOVES_A_BOX: usize = 4;

/// Moves that insertion has ahead of these, so that it does not give up for the first entries.
const MOVES_AHEAD: usize = 512;

/// Frames after one in which insertion gave up that do without: boxes mostly go on as they did, and to try takes a tenth of
/// a frame.
const UNTRIED: u32 = 7;

/// Most boxes that are dealt into buckets: the counters of more leave the first-level cache.
const DEALT_MOST: usize = 4_096;
/// Buckets for each box, about: with so many, one box in eight has another one in its bucket before it
/// that belongs behind it.
const BUCKETS_A_BOX: usize = 2;
/// 1.5 · 2^23: added to a number below 2^22 it leaves the nearest integer in the low bits of the sum. A
/// conversion of eight numbers is no instruction of every processor.
const ROUND: f32 = 12_582_912.0;

/// Bits of a radix digit: its counters, 8 KiB, stay in the first-level cache.
const DIGIT_BITS: u32 = 11;
const DIGITS: u32 = 3;
const BUCKETS: usize = 1 << DIGIT_BITS;
/// Entries that are moved between two looks whether anybody waits for the answer: some 100 µs.
const MOVED_AT_ONCE: usize = 1 << 15;

/// Sorted entries. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct SweepOrder {
    entries: Vec<Entry>,
    scratch: Vec<Entry>,
    /// Frames to come that do without insertion.
    untried: u32,
    counts: Vec<[u32; BUCKETS]>,
    /// Bucket of each box that is dealt.
    buckets: Vec<u16>,
    /// Boxes of each of these buckets, then where the next one goes.
    dealt: Vec<u16>,
}

impl SweepOrder {
    /// Sorts the boxes with these min keys.
    ///
    /// # Errors
    /// [`CullError::Cancelled`]: the next sort starts afresh.
    pub fn sort(&mut self, min: &[i32], cancel: &Cancel) -> Result<(), CullError> {
        if self.untried > 0 {
            self.untried -= 1;
        } else if self.entries.len() == min.len() {
            for entry in &mut self.entries {
                *entry = new_entry(min, *entry as u32);
            }
            if insert(&mut self.entries) {
                return Ok(());
            }
            self.untried = UNTRIED;
        }
        if (min.len() > DEALT_MOST || !self.deal(min)) && !self.radix_sort(min, cancel) {
            self.entries.clear();
            return Err(CullError::Cancelled);
        }
        Ok(())
    }

    pub fn allocated_bytes(&self) -> usize {
        (self.entries.capacity() + self.scratch.capacity()) * size_of::<Entry>()
            + self.counts.capacity() * size_of::<[u32; BUCKETS]>()
            + (self.buckets.capacity() + self.dealt.capacity()) * size_of::<u16>()
    }

    /// Index of the box at each position.
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        self.entries.iter().map(|entry| *entry as u32)
    }

    /// Deals the boxes into buckets of equal width and puts the rest right by insertion; whether that came
    /// to the end. Which bucket a box is in changes the time alone, regardless of the floating-point flags.
    fn deal(&mut self, min: &[i32]) -> bool {
        let bucket_count = (BUCKETS_A_BOX * min.len()).next_power_of_two();
        let Some((low, scale)) = even_buckets(min, bucket_count) else { return false };
        let last = bucket_count as f32 - 1.0;
        self.buckets.clear();
        self.buckets.extend(min.iter().map(|key| {
            // A NaN, from a box that overlaps nothing, becomes the last one.
            let slot = ((coordinate(*key) - low) * scale).min(last).max(0.0);
            (slot + ROUND).to_bits() as u16
        }));
        self.dealt.clear();
        self.dealt.resize(bucket_count, 0);
        let mask = bucket_count - 1;
        for bucket in &self.buckets {
            self.dealt[usize::from(*bucket) & mask] += 1;
        }
        let mut start = 0;
        for next in &mut self.dealt {
            let count = *next;
            *next = start;
            start += count;
        }
        self.entries.resize(min.len(), 0);
        for (index, bucket) in (0..).zip(&self.buckets) {
            let next = &mut self.dealt[usize::from(*bucket) & mask];
            self.entries[usize::from(*next)] = new_entry(min, index);
            *next += 1;
        }
        insert(&mut self.entries)
    }

    /// From the least digit to the most, each pass stable, from the order of indices. Whether it came to the end, and
    /// was not cancelled.
    fn radix_sort(&mut self, min: &[i32], cancel: &Cancel) -> bool {
        self.entries.clear();
        self.entries.extend((0..min.len() as u32).map(|i| new_entry(min, i)));
        self.scratch.resize(min.len(), 0);
        self.counts.clear();
        self.counts.resize(DIGITS as usize, [0; BUCKETS]);
        for entry in &self.entries {
            for (digit, counts) in (0..).zip(&mut self.counts) {
                counts[bucket(*entry, digit)] += 1;
            }
        }
        for (digit, counts) in (0..).zip(&mut self.counts) {
            let mut start = 0;
            for count in counts.iter_mut() {
                let end = start + *count;
                *count = start;
                start = end;
            }
            for some in self.entries.chunks(MOVED_AT_ONCE) {
                if min.len() > MOVED_AT_ONCE && cancel.look() {
                    return false;
                }
                for entry in some {
                    let next = &mut counts[bucket(*entry, digit)];
                    self.scratch[*next as usize] = *entry;
                    *next += 1;
                }
            }
            std::mem::swap(&mut self.entries, &mut self.scratch);
        }
        true
    }
}

fn new_entry(min: &[i32], index: u32) -> Entry {
    // Flipping the sign bit makes signed keys order as unsigned numbers.
    let key = min[index as usize] as u32 ^ 1 << 31;
    u64::from(key) << 32 | u64::from(index)
}

fn bucket(entry: Entry, digit: u32) -> usize {
    (entry >> (32 + digit * DIGIT_BITS)) as usize % BUCKETS
}

/// The smallest finite coordinate, and buckets for each unit of length above it. `None` where there is no
/// length to share out.
fn even_buckets(min: &[i32], bucket_count: usize) -> Option<(f32, f32)> {
    let infinite = order_key(f32::INFINITY.to_bits());
    let finite = |key: i32, other: i32| {
        if (-infinite < key) & (key < infinite) { key } else { other }
    };
    let (low, high) = min.iter().fold((i32::MAX, i32::MIN), |(low, high), key| {
        (low.min(finite(*key, i32::MAX)), high.max(finite(*key, i32::MIN)))
    });
    let (low, high) = (coordinate(low), coordinate(high));
    let scale = (bucket_count - 1) as f32 / (high - low);
    (scale.is_finite() && scale > 0.0).then_some((low, scale))
}

/// Insertion sort, given up where entries move so far that the whole would take too long; whether it came
/// to the end.
fn insert(entries: &mut [Entry]) -> bool {
    let mut moves = MOVES_AHEAD;
    for i in 1..entries.len() {
        let entry = entries[i];
        let mut hole = i;
        while hole > 0 && entries[hole - 1] > entry {
            entries[hole] = entries[hole - 1];
            hole -= 1;
        }
        entries[hole] = entry;
        let moved = i - hole;
        moves += MOVES_A_BOX;
        if moved > moves {
            return false;
        }
        moves -= moved;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(order: &mut SweepOrder, min: &[i32]) {
        order.sort(min, &Cancel::never()).expect("never cancelled");
        let mut expected: Vec<u32> = (0..min.len() as u32).collect();
        expected.sort_by_key(|i| (min[*i as usize], *i));
        assert!(order.indices().eq(expected));
    }

    #[test]
    fn small_and_large_moves_give_the_sorted_order() {
        let mut order = SweepOrder::default();
        let mut keys: Vec<i32> =
            (0..3000i32).map(|i| i.wrapping_mul(0x9e37_79b1_u32 as i32)).collect();
        check(&mut order, &keys);
        for round in 0..5 {
            for (i, key) in keys.iter_mut().enumerate() {
                *key = key.wrapping_add((i as i32 * 7919 + round) % 100_000);
            }
            check(&mut order, &keys);
        }
        keys.reverse();
        check(&mut order, &keys);
        check(&mut order, &[]);
        check(&mut order, &[5, 5, i32::MIN, i32::MAX, 5, -1]);
    }

    #[test]
    fn however_boxes_are_spread_their_order_is_the_sorted_one() {
        let even = |i: usize| (i * 7919 % 1000) as f32;
        let spreads: [&dyn Fn(usize) -> f32; 5] = [
            &even,
            &|i| if i == 500 { -1e30 } else { even(i) },
            &|i| if i % 2 == 0 { 1.0 } else { -f32::MAX },
            &|i| if i % 3 == 0 { f32::INFINITY } else { even(i) },
            &|i| even(i).exp2() - 1e-3,
        ];
        for at in spreads {
            for n in [1, 2, 100, 1_000, DEALT_MOST, DEALT_MOST + 1] {
                let mut keys: Vec<i32> = (0..n).map(|i| order_key(at(i).to_bits())).collect();
                check(&mut SweepOrder::default(), &keys);
                // Boxes that overlap nothing.
                keys.iter_mut().step_by(7).for_each(|key| *key = i32::MAX);
                check(&mut SweepOrder::default(), &keys);
            }
        }
    }

    proptest! {
        #[test]
        fn any_two_frames(
            first in prop::collection::vec(any::<i32>(), 0..200),
            second in prop::collection::vec(-3i32..3, 0..200),
        ) {
            let mut order = SweepOrder::default();
            check(&mut order, &first);
            check(&mut order, &second);
            check(&mut order, &first);
        }
    }
}
