//! A group's boxes brought before and behind a cut.
//!
//! The number that a group is cut by is written out for each box, side by side, so that counting those below a
//! threshold takes a cycle or two for each register of them. The threshold that has the right number of boxes below it is
//! found by counting, and then only boxes that stand on the wrong side are moved, by twos: a quarter of what a
//! selection moves in each of its passes, and no branch of it depends on a box.

use std::cmp::Ordering;

use super::arrange::Entry;
use super::cut::By;
use crate::aabb::order_key;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// Keys whose bits are looked at together.
const BLOCK: usize = u64::BITS as usize;

/// Rounds after which a threshold is found where numbers differ, in most groups of a few boxes.
const FEW_ROUNDS: usize = 8;

/// Brings the `at` boxes with the least numbers to the front, neither none of them nor all; about so many are below the
/// guess. `keys` has room for one each.
///
/// Which of several boxes with the same number come first depends on their places alone.
pub(super) fn divide(
    entries: &mut [Entry],
    keys: &mut [i32],
    at: usize,
    (by, guess): (By, f32),
    isa: AvailableIsa,
) {
    let range = write_keys(entries, keys, by, isa);
    let threshold = threshold(keys, at, range, order_key(guess.to_bits()), isa);
    exchange(entries, keys, at, threshold, isa);
}

per_isa! {
    /// Writes the number of each box, as a key; the least, and the one after the largest.
    fn write_keys<simd: S>(entries: &[Entry], keys: &mut [i32], by: By) -> [i32; 2] {
        let _ = simd;
        let (mut least, mut most) = (i32::MAX, i32::MIN);
        for (key, entry) in keys.iter_mut().zip(entries) {
            *key = order_key(by.of(&entry.aabb).to_bits());
            (least, most) = (least.min(*key), most.max(*key));
        }
        [least, most + 1]
    }
}

/// A key that `at` of the keys, neither none nor all, are below. `guess` is looked at first. Among equal ones the first
/// are lowered where only some of them shall be below.
fn threshold(
    keys: &mut [i32],
    at: usize,
    [mut low, mut high]: [i32; 2],
    guess: i32,
    isa: AvailableIsa,
) -> i32 {
    let (mut below_low, mut below_high) = (0, keys.len());
    let mut next = guess;
    for round in 0usize.. {
        let width = i64::from(high) - i64::from(low);
        if width <= 1 {
            break;
        }
        let probe = next.clamp(low + 1, high - 1);
        let below = count_below(keys, probe, isa);
        // Nothing lies on one side of it, and not for the first time: what is left may be boxes with the same number.
        let is_apart = round >= FEW_ROUNDS && (below == below_low || below == below_high);
        match below.cmp(&at) {
            Ordering::Equal => return probe,
            Ordering::Less => (low, below_low) = (probe, below),
            Ordering::Greater => (high, below_high) = (probe, below),
        }
        if is_apart {
            [low, high] = range_within(keys, [low, high], isa);
        }
        // By the counts, which is nearly right where boxes are spread evenly; every other time in the middle, so
        // that it ends elsewhere too.
        let width = i64::from(high) - i64::from(low);
        let step = if round % 2 == 0 {
            i128::from(width) * (at - below_low) as i128 / (below_high - below_low) as i128
        } else {
            i128::from(width / 2)
        };
        next = (i128::from(low) + step) as i32;
    }
    let equal = keys.iter_mut().filter(|key| **key == low);
    equal.take(at - below_low).for_each(|key| *key -= 1);
    low
}

per_isa! {
    /// Of keys within a range, the least and the one after the largest. There must be some.
    fn range_within<simd: S>(keys: &[i32], range: [i32; 2]) -> [i32; 2] {
        let _ = simd;
        let (mut least, mut most) = (i32::MAX, i32::MIN);
        for key in keys {
            least = least.min(if *key >= range[0] { *key } else { i32::MAX });
            most = most.max(if *key < range[1] { *key } else { i32::MIN });
        }
        [least, most + 1]
    }
}

per_isa! {
    /// How many of the keys are below another.
    fn count_below<simd: S>(keys: &[i32], threshold: i32) -> usize {
        let limit = simd.splat(threshold);
        let mut blocks = keys.chunks_exact(S::LANES);
        let mut count = 0;
        for block in &mut blocks {
            count += simd.bits(simd.above(limit, simd.load(block))).count_ones();
        }
        for key in blocks.remainder() {
            count += u32::from(*key < threshold);
        }
        count as usize
    }
}

per_isa! {
    /// Exchanges the boxes of the first `at` whose keys are not below a threshold with those behind whose are: as
    /// many.
    fn exchange<simd: S>(
        entries: &mut [Entry],
        keys: &[i32],
        at: usize,
        threshold: i32,
    ) {
        let limit = simd.splat(threshold);
        // Bit i: key i of a block is below.
        let below = |block: &[i32]| {
            let mut bits = 0u64;
            let mut parts = block.chunks_exact(S::LANES);
            let mut place = 0;
            for part in &mut parts {
                bits |= u64::from(simd.bits(simd.above(limit, simd.load(part)))) << place;
                place += S::LANES;
            }
            for key in parts.remainder() {
                bits |= u64::from(*key < threshold) << place;
                place += 1;
            }
            bits
        };
        let (mut front, mut back) = ([0, 0], [0, at]);
        let (mut high, mut low) = (0u64, 0u64);
        loop {
            while high == 0 {
                if front[1] == at {
                    return;
                }
                front = [front[1], at.min(front[1] + BLOCK)];
                let block = &keys[front[0]..front[1]];
                high = !below(block) & (u64::MAX >> (BLOCK - block.len()));
            }
            while low == 0 {
                if back[1] == keys.len() {
                    return;
                }
                back = [back[1], keys.len().min(back[1] + BLOCK)];
                low = below(&keys[back[0]..back[1]]);
            }
            for _ in 0..high.count_ones().min(low.count_ones()) {
                let place = front[0] + high.trailing_zeros() as usize;
                entries.swap(place, back[0] + low.trailing_zeros() as usize);
                (high, low) = (high & (high - 1), low & (low - 1));
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use bytemuck::Zeroable;

    use super::super::arrange::read;
    use super::*;
    use crate::aabb::Aabb;
    use crate::isa::Isa;
    use crate::random::Random;

    fn entries(numbers: impl Iterator<Item = f32>) -> Vec<Entry> {
        let boxes: Vec<Aabb> = numbers.map(|x| Aabb::new([x, 0.0, 0.0], [x, 1.0, 1.0])).collect();
        let mut entries = vec![Entry::zeroed(); boxes.len()];
        read(&boxes, &mut entries, 1);
        entries
    }

    fn number(entry: &Entry) -> f32 {
        By::ALL[0].of(&entry.aabb)
    }

    /// Divides in every place that is asked for, on every instruction set; each gives the same order.
    fn check(entries: &[Entry], places: impl Iterator<Item = usize>) {
        for at in places {
            for guess in [number(&entries[0]), f32::NEG_INFINITY, 0.0, f32::INFINITY] {
                let mut orders = Isa::ALL.into_iter().filter_map(AvailableIsa::new).map(|isa| {
                    let (mut divided, mut keys) = (entries.to_vec(), vec![0; entries.len()]);
                    divide(&mut divided, &mut keys, at, (By::ALL[0], guess), isa);
                    let (low, high) = divided.split_at(at);
                    let most = low.iter().map(number).fold(f32::NEG_INFINITY, f32::max);
                    let least = high.iter().map(number).fold(f32::INFINITY, f32::min);
                    assert!(most <= least, "{most} before {least}: {at} of {}", entries.len());
                    divided.iter().map(|entry| entry.index).collect::<Vec<u32>>()
                });
                let first = orders.next().unwrap();
                assert!(orders.all(|order| order == first));
                let mut sorted = first;
                sorted.sort_unstable();
                assert!(sorted.into_iter().eq(0..entries.len() as u32));
            }
        }
    }

    #[test]
    fn the_least_come_first_however_numbers_are_spread() {
        let mut random = Random(7);
        for len in [2, 17, 63, 64, 65, 300] {
            let mut next = |scale: f32| (random.below(1_000) as f32 - 500.0) * scale;
            let even: Vec<f32> = (0..len).map(|_| next(1.0)).collect();
            let wide: Vec<f32> = (0..len).map(|_| next(1.0).exp()).collect();
            let tied: Vec<f32> = (0..len).map(|_| (next(0.01)).round()).collect();
            let half: Vec<f32> = (0..len).map(|i| (i % 2) as f32).collect();
            let ends = [f32::NEG_INFINITY, f32::INFINITY, -0.0, 0.0, f32::MAX, f32::MIN];
            let ends: Vec<f32> = (0..len).map(|i| ends[i % ends.len()]).collect();
            let mut sorted = even.clone();
            sorted.sort_by(f32::total_cmp);
            let reversed: Vec<f32> = sorted.iter().rev().copied().collect();
            for numbers in [even, wide, tied, half, ends, vec![1.0; len], sorted, reversed] {
                check(&entries(numbers.into_iter()), (1..len).step_by(1 + len / 9));
            }
        }
    }
}
