//! Times on the CPU, by the host's clock.

use std::hint::black_box;
use std::time::Instant;

use pairmask_core::BoxCount;
use rayon::prelude::*;

use super::Plan;
use super::stage::{Root, Variant};
use super::variants::{next_pair, row_search, with_map, with_root};
use crate::study::harness::{median, repeated};

const CHUNK: u64 = 1 << 15;

/// Most ids that are timed: with more, the time of each stays the same.
const MOST: u64 = 1 << 26;

/// Time to map every id of `n` boxes, in ms. Past 2^26 ids (2^23 on one thread) only that many are
/// timed, evenly spread, and the time is scaled up.
pub fn map_all(variant: Variant, n: BoxCount, on_all: bool, plan: &Plan) -> Option<f64> {
    let total = variant.id_count(n.get());
    if total == 0 {
        return None;
    }
    if variant != Variant::WordStep {
        return Some(with_map!(variant, map => ms(total, on_all, plan, |first, end| {
            (first..end).fold(0, |sum: u64, k| {
                let [a, b] = map(n, k);
                // The test of the pair is part of the lazy way's work.
                if a < b { sum.wrapping_add((a ^ b) as u64) } else { sum }
            })
        })));
    }
    Some(ms(total, on_all, plan, |first, end| {
        let (mut sum, mut k) = (0, first);
        while k < end {
            let mut pair = row_search(n, k).map(|index| index as u32);
            let word_end = end.min(k + 32);
            while k < word_end {
                sum += u64::from(pair[0] ^ pair[1]);
                pair = next_pair(n, pair);
                k += 1;
            }
        }
        sum
    }))
}

pub fn roots(root: Root, count: u64, on_all: bool, plan: &Plan) -> f64 {
    with_root!(root, root => ms(count, on_all, plan, |first, end| {
        // 32-bit numbers: converting a 64-bit one costs more than a root.
        let sum = |sum: u32, x: u32| sum.wrapping_add(root(x as f32) as u32);
        (first as u32..end as u32).fold(0, sum) as u64
    }))
}

/// Median time for `work` over all chunks of 0..total, in ms.
fn ms(total: u64, on_all: bool, plan: &Plan, work: impl Fn(u64, u64) -> u64 + Sync) -> f64 {
    let most = if on_all { MOST } else { MOST / 8 }.min(plan.most_cpu_ids);
    let chunks = total.div_ceil(CHUNK);
    let taken = chunks.min(most.div_ceil(CHUNK)).max(1);
    let stride = chunks / taken;
    let run = |chunk: u64| {
        let first = chunk * stride * CHUNK;
        let end = total.min(first + CHUNK);
        black_box(work(black_box(first), end));
        end - first
    };
    let once = || {
        let start = Instant::now();
        let done: u64 = if on_all {
            (0..taken).into_par_iter().map(run).sum()
        } else {
            (0..taken).map(run).sum()
        };
        start.elapsed().as_secs_f64() * 1e3 * (total as f64 / done as f64)
    };
    median(repeated(plan.time, 3, once))
}
