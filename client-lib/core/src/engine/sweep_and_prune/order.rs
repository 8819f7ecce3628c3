//! Boxes by their min key on the sweep axis, ties by index.
//!
//! The order of the last frame is where this frame starts: boxes that moved a little are a few
//! places off, and insertion puts them right (Cohen et al. 1995, the persistent method that the
//! papers name). Where that takes too long, a radix sort starts afresh. The result is the same: no
//! two entries are equal, so there is one sorted order.

/// Min key (in the upper half) and index of a box. Sorts as a number.
type Entry = u64;

/// Places that insertion may move an entry on average before the radix sort is cheaper.
const MOVES_A_BOX: usize = 4;

/// Bits of a radix digit: its counters, 8 KiB, stay in the first-level cache.
const DIGIT_BITS: u32 = 11;
const DIGITS: u32 = 3;
const BUCKETS: usize = 1 << DIGIT_BITS;

/// Sorted entries. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct SweepOrder {
    entries: Vec<Entry>,
    scratch: Vec<Entry>,
    counts: Vec<[u32; BUCKETS]>,
}

impl SweepOrder {
    /// Sorts the boxes with these min keys.
    pub fn sort(&mut self, min: &[i32]) {
        if self.entries.len() == min.len() {
            for entry in &mut self.entries {
                *entry = new_entry(min, *entry as u32);
            }
            if insert(&mut self.entries, MOVES_A_BOX * min.len()) {
                return;
            }
        }
        self.radix_sort(min);
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        (self.entries.capacity() + self.scratch.capacity()) * size_of::<Entry>()
            + self.counts.capacity() * size_of::<[u32; BUCKETS]>()
    }

    /// Index of the box at each position.
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        self.entries.iter().map(|entry| *entry as u32)
    }

    /// From the least digit to the most, each pass stable, from the order of indices.
    fn radix_sort(&mut self, min: &[i32]) {
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
            for entry in &self.entries {
                let next = &mut counts[bucket(*entry, digit)];
                self.scratch[*next as usize] = *entry;
                *next += 1;
            }
            std::mem::swap(&mut self.entries, &mut self.scratch);
        }
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

/// Insertion sort, given up after so many moves; whether it came to the end.
fn insert(entries: &mut [Entry], mut moves: usize) -> bool {
    for i in 1..entries.len() {
        let entry = entries[i];
        let mut hole = i;
        while hole > 0 && entries[hole - 1] > entry {
            entries[hole] = entries[hole - 1];
            hole -= 1;
        }
        entries[hole] = entry;
        let moved = i - hole;
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
        order.sort(min);
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
