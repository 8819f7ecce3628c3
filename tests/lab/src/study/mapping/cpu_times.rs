//! Times on the CPU, by the host's clock.

use std::hint::black_box;
use std::time::Instant;

use pairmask_core::BoxCount;
use rayon::prelude::*;

use super::Budget;
use super::mirror::{MapVisitor, Mapped, next_pair, row_search, with_map};
use super::roots::{RootVisitor, with_root};
use crate::study::mapping::stage::{Root, Variant};

/// Ids of a task.
const CHUNK: u64 = 1 << 15;

/// Most ids that are timed: with more, the time of each stays the same.
const MOST: u64 = 1 << 26;

/// One thread or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// One.
    One,
    /// All of the machine.
    All,
}

/// Time to map every id of `n` boxes, in ms. Past 2^26 ids (2^23 on one thread) only that many are
/// timed, evenly spread, and the time is scaled up.
pub fn map_all(variant: Variant, n: BoxCount, threads: Threads, budget: &Budget) -> Option<f64> {
    let total = variant.id_count(n.get());
    if total == 0 {
        return None;
    }
    if variant == Variant::WordStep {
        return timed(total, threads, budget, |first, end| {
            let (mut sum, mut k) = (0, first);
            while k < end {
                let Mapped { a, b } = row_search(n, k);
                let mut pair = (a as u32, b as u32);
                let word_end = end.min(k + 32);
                while k < word_end {
                    sum += u64::from(pair.0 ^ pair.1);
                    pair = next_pair(n, pair);
                    k += 1;
                }
            }
            sum
        });
    }
    with_map(variant, Timed { n, total, threads, budget })
}

struct Timed<'a> {
    n: BoxCount,
    total: u64,
    threads: Threads,
    budget: &'a Budget,
}

impl MapVisitor for Timed<'_> {
    type Out = Option<f64>;

    fn visit(self, map: impl Fn(BoxCount, u64) -> Mapped + Copy + Sync) -> Option<f64> {
        let Self { n, total, threads, budget } = self;
        timed(total, threads, budget, |first, end| {
            (first..end).fold(0, |sum: u64, k| {
                let Mapped { a, b } = map(n, k);
                // The test of the pair is part of the lazy way's work.
                if a < b { sum.wrapping_add((a ^ b) as u64) } else { sum }
            })
        })
    }
}

/// Time to take the roots of 1 to `count`, in ms.
pub fn roots(root: Root, count: u64, threads: Threads, budget: &Budget) -> Option<f64> {
    with_root(root, TimedRoots { count, threads, budget })
}

struct TimedRoots<'a> {
    count: u64,
    threads: Threads,
    budget: &'a Budget,
}

impl RootVisitor for TimedRoots<'_> {
    type Out = Option<f64>;

    fn visit(self, root: impl Fn(f32) -> f32 + Copy + Sync) -> Option<f64> {
        timed(self.count, self.threads, self.budget, |first, end| {
            // 32-bit numbers: converting a 64-bit one costs more than a root.
            (first as u32..end as u32)
                .fold(0, |sum: u32, x| sum.wrapping_add(root(x as f32) as u32)) as u64
        })
    }
}

/// Median time for `work` over all chunks of 0..total, in ms.
fn timed(
    total: u64,
    threads: Threads,
    budget: &Budget,
    work: impl Fn(u64, u64) -> u64 + Sync,
) -> Option<f64> {
    let most = if threads == Threads::All { MOST } else { MOST / 8 }.min(budget.most_cpu_ids);
    let chunks = total.div_ceil(CHUNK);
    let taken = chunks.min(most.div_ceil(CHUNK)).max(1);
    let stride = chunks / taken;
    let ids = |chunk: u64| {
        let first = chunk * stride * CHUNK;
        first..total.min(first + CHUNK)
    };
    let run = |chunk: u64| {
        let ids = ids(chunk);
        black_box(work(black_box(ids.start), ids.end));
        ids.end - ids.start
    };
    let mut times = Vec::new();
    let started = Instant::now();
    while times.len() < 3 || started.elapsed() < budget.time {
        let start = Instant::now();
        let done: u64 = match threads {
            Threads::One => (0..taken).map(run).sum(),
            Threads::All => (0..taken).into_par_iter().map(run).sum(),
        };
        times.push(start.elapsed().as_secs_f64() * 1e3 * (total as f64 / done as f64));
    }
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied()
}
