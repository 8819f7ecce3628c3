//! Speed of mask decoding: `cargo bench -p pairmask-tests --bench decode`.
//!
//! Medians of many runs, warm. Every row prints the time of one decode, ns for each pair and GB/s
//! over the bytes of the mask (its order included). The reference rows say what the memory and the
//! consumer alone cost on this machine in this run, so that ratios hold on a noisy one.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask::BoxCount;
use pairmask::mask::MaskView;
use pairmask_tests::mask_writer::{WrittenMask, write_dense, write_sparse};
use pairmask_tests::oracle::Pair;
use pairmask_tests::pair_scenes::{
    all_pairs, grid_like_pairs, random_order, random_pairs, renamed,
};
use rayon::iter::ParallelIterator;

/// Time spent on each row: long enough for a median of several hundred short runs.
const ROW_TIME: Duration = Duration::from_millis(150);

fn main() {
    println!("{:44} {:>10} {:>9} {:>9} {:>8}", "", "pairs", "µs", "ns/pair", "GB/s");
    dense("dense, no pair", 4_096, &[]);
    dense("dense, 1 pair a box", 1_000, &random_pairs(BoxCount::new(1_000), 1_000, 1));
    dense("dense, 1 pair a box", 4_096, &random_pairs(BoxCount::new(4_096), 4_096, 1));
    dense("dense, 1 pair a box", 16_384, &random_pairs(BoxCount::new(16_384), 16_384, 1));
    dense("dense, 7 pairs a box", 4_096, &random_pairs(BoxCount::new(4_096), 7 * 4_096, 1));
    dense("dense, every pair", 2_048, &all_pairs(BoxCount::new(2_048)));
    for n in [10_000, 100_000, 1_000_000] {
        let count = BoxCount::new(n);
        sparse("sparse, 1 pair a box", n, &grid_like_pairs(count, 1.0, 1));
        sparse("sparse, 7 pairs a box", n, &grid_like_pairs(count, 7.0, 1));
        sparse("sparse, far partners", n, &random_pairs(count, n as usize, 1));
    }
}

fn dense(name: &str, n: u32, pairs: &[Pair]) {
    let mask = write_dense(BoxCount::new(n), pairs);
    println!("\n{name}, n = {n}");
    decode(&mask, pairs.len());
}

fn sparse(name: &str, n: u32, pairs: &[Pair]) {
    let count = BoxCount::new(n);
    let plain = write_sparse(count, pairs, None);
    println!("\n{name}, n = {n}");
    decode(&plain, pairs.len());
    let order = random_order(count, 2);
    let ordered = write_sparse(count, &renamed(pairs, &order), Some(&order));
    println!("{name}, n = {n}, random order");
    decode(&ordered, pairs.len());
}

/// All ways through one mask.
fn decode(written: &WrittenMask, expected: usize) {
    let mask = MaskView::new(written.n, &written.shape, &written.reply).expect("shape and reply");
    assert_eq!(mask.pairs().count(), expected, "a bench of a wrong decoder measures nothing");
    let row = |name: &str, median: Duration| {
        let ns = median.as_secs_f64() * 1e9;
        let bytes = written.shape.mask_bytes() as f64;
        let per_pair = if expected == 0 { f64::NAN } else { ns / expected as f64 };
        println!(
            "    {name:40} {expected:>10} {:>9.1} {per_pair:>9.2} {:>8.2}",
            ns / 1e3,
            bytes / ns
        );
    };
    row("reference: OR of all words", median_of(|| written.reply.iter().fold(0, |or, w| or | w)));
    let known = mask.to_vec();
    let mut list = Vec::with_capacity(known.len());
    row(
        "reference: copy of the pairs",
        median_of(|| {
            list.clear();
            list.extend_from_slice(black_box(&known));
        }),
    );
    row(
        "for_each, sum",
        median_of(|| {
            let mut sum = 0u64;
            mask.for_each(|a, b| sum += u64::from(a ^ b));
            sum
        }),
    );
    row(
        "for_each, push",
        median_of(|| {
            list.clear();
            mask.for_each(|a, b| list.push((a, b)));
        }),
    );
    row(
        "append_to",
        median_of(|| {
            list.clear();
            mask.append_to(&mut list);
        }),
    );
    row(
        "for loop, sum",
        median_of(|| {
            let mut sum = 0u64;
            for (a, b) in mask.pairs() {
                sum += u64::from(a ^ b);
            }
            sum
        }),
    );
    row("count", median_of(|| mask.count()));
    row(
        "par_pairs, sum",
        median_of(|| mask.par_pairs().map(|(a, b)| u64::from(a ^ b)).sum::<u64>()),
    );
}

/// Median time of `run` over [`ROW_TIME`], after a warm-up.
fn median_of<T>(mut run: impl FnMut() -> T) -> Duration {
    let mut times = Vec::new();
    black_box(run());
    let start = Instant::now();
    while start.elapsed() < ROW_TIME || times.len() < 5 {
        let before = Instant::now();
        black_box(run());
        times.push(before.elapsed());
    }
    times.sort_unstable();
    times[times.len() / 2]
}
