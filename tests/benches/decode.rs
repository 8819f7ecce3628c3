//! Speed of mask decoding: `cargo bench -p pairmask-tests --bench decode [-- PART OF A NAME]`.
//!
//! Medians of many runs, warm. Every row prints the time of one decode, ns for each pair and GB/s over the bytes of the
//! mask (its order included). The reference rows say what the memory and the consumer alone cost on this machine in this
//! run, so that ratios hold on a noisy one.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask_tests::mask_writer::{
    WrittenMask, all_pairs, grid_like_pairs, random_order, random_pairs, renamed, write_dense,
    write_list, write_sparse,
};
use pairmask_tests::prelude::*;
use rayon::iter::ParallelIterator;

/// Time spent on each row: long enough for a median of several hundred short runs.
const ROW_TIME: Duration = Duration::from_millis(150);

fn main() {
    let filter = std::env::args().skip(1).find(|arg| !arg.starts_with("--")).unwrap_or_default();
    println!("{:44} {:>10} {:>9} {:>9} {:>8}", "", "pairs", "µs", "ns/pair", "GB/s");
    for (name, n, pairs) in SCENES {
        let (n, title) = (BoxCount::new(*n), format!("{name}, n = {n}"));
        if !title.contains(&filter) {
            continue;
        }
        let pairs = pairs(n);
        if name.starts_with("dense") {
            decode(&title, &write_dense(n, &pairs), pairs.len());
        } else {
            decode(&title, &write_sparse(n, &pairs, None), pairs.len());
            let order = random_order(n, 2);
            let ordered = write_sparse(n, &renamed(&pairs, &order), Some(&order));
            decode(&format!("{title}, random order"), &ordered, pairs.len());
            decode(&format!("{title}, list"), &write_list(n, &pairs), pairs.len());
        }
    }
}

/// Name, boxes and pairs of positions of a scene.
type Scene = (&'static str, u32, fn(BoxCount) -> Vec<Pair>);

const SCENES: &[Scene] = &[
    ("dense, no pair", 4_096, |_| Vec::new()),
    ("dense, 1 pair a box", 1_000, one_a_box),
    ("dense, 1 pair a box", 4_096, one_a_box),
    ("dense, 1 pair a box", 16_384, one_a_box),
    ("dense, 7 pairs a box", 4_096, |n| random_pairs(n, 7 * n.len(), 1)),
    ("dense, every pair", 2_048, all_pairs),
    ("sparse, 1 pair a box", 1_000, |n| grid_like_pairs(n, 1.0, 1)),
    ("sparse, 1 pair a box", 10_000, |n| grid_like_pairs(n, 1.0, 1)),
    ("sparse, 7 pairs a box", 10_000, |n| grid_like_pairs(n, 7.0, 1)),
    ("sparse, far partners", 10_000, one_a_box),
    ("sparse, 1 pair a box", 100_000, |n| grid_like_pairs(n, 1.0, 1)),
    ("sparse, 7 pairs a box", 100_000, |n| grid_like_pairs(n, 7.0, 1)),
    ("sparse, far partners", 100_000, one_a_box),
    ("sparse, 1 pair a box", 1_000_000, |n| grid_like_pairs(n, 1.0, 1)),
    ("sparse, 7 pairs a box", 1_000_000, |n| grid_like_pairs(n, 7.0, 1)),
    ("sparse, far partners", 1_000_000, one_a_box),
];

/// As many random pairs as boxes.
fn one_a_box(n: BoxCount) -> Vec<Pair> {
    random_pairs(n, n.len(), 1)
}

fn decode(title: &str, written: &WrittenMask, expected: usize) {
    let mask = MaskView::new(written.n, &written.shape, &written.reply).expect("shape and reply");
    println!("\n{title}");
    assert_eq!(mask.pairs().count(), expected, "a bench of a wrong decoder measures nothing");
    let row = |name: &str, run: &mut dyn FnMut()| {
        let ns = median_of(run).as_secs_f64() * 1e9;
        let bytes = written.shape.mask_bytes() as f64;
        let per_pair = if expected == 0 { f64::NAN } else { ns / expected as f64 };
        let (us, rate) = (ns / 1e3, bytes / ns);
        println!("    {name:40} {expected:>10} {us:>9.1} {per_pair:>9.2} {rate:>8.2}");
    };
    let known = mask.to_vec();
    let mut list = Vec::with_capacity(known.len());
    row("reference: OR of all words", &mut || {
        black_box(written.reply.iter().fold(0, |or, w| or | w));
    });
    row("reference: copy of the pairs", &mut || {
        list.clear();
        list.extend_from_slice(black_box(&known));
    });
    row("for_each, sum", &mut || {
        let mut sum = 0u64;
        mask.for_each(|a, b| sum += u64::from(a ^ b));
        black_box(sum);
    });
    row("for_each_slice, sum", &mut || {
        let mut sum = 0u64;
        mask.for_each_slice(|pairs| {
            sum += pairs.iter().map(|[a, b]| u64::from(a ^ b)).sum::<u64>();
        });
        black_box(sum);
    });
    row("for_each, push", &mut || {
        list.clear();
        mask.for_each(|a, b| list.push([a, b]));
    });
    row("append_to", &mut || {
        list.clear();
        mask.append_to(&mut list);
    });
    row("for loop, sum", &mut || {
        let mut sum = 0u64;
        for [a, b] in mask.pairs() {
            sum += u64::from(a ^ b);
        }
        black_box(sum);
    });
    row("count", &mut || {
        black_box(mask.count());
    });
    row("par_pairs, sum", &mut || {
        black_box(mask.par_pairs().map(|[a, b]| u64::from(a ^ b)).sum::<u64>());
    });
}

/// Median time of `run` over [`ROW_TIME`], after a warm-up.
fn median_of(run: &mut dyn FnMut()) -> Duration {
    let mut times = Vec::new();
    run();
    let start = Instant::now();
    while start.elapsed() < ROW_TIME || times.len() < 5 {
        let before = Instant::now();
        run();
        times.push(before.elapsed());
    }
    times.sort_unstable();
    times[times.len() / 2]
}
