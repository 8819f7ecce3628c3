//! Errors of ways to decide a pair of spheres, found by exact arithmetic.

use std::sync::Arc;

use pairmask_core::engine::{CullError, CullInput, HeapReply};
use pairmask_core::objects::Objects;
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{BoxCount, Encoding, PairIndex};
use pairmaskd::execute::gpu::{AllPairs, EngineOptions, Gpu};
use pairmaskd::scene::Random;
use rayon::prelude::*;

use super::families::{ALL, Family};
use super::oracle::overlap;
use crate::Result;
use crate::study::harness::{Fields, row};

const CHUNK: u64 = 10_000;

const COUNTS: [&str; 7] =
    ["pairs", "overlapping", "exact_wrong", "f32_missed", "f32_extra", "root_missed", "root_extra"];

fn judged(a: &Sphere, b: &Sphere) -> [u64; COUNTS.len()] {
    let (truth, squared) = (overlap(a, b), squared_f32(a, b));
    // The paper's test (algorithm 1): the distance itself.
    let root = distance_squared(a, b).sqrt() <= a.radius + b.radius;
    let exact_wrong = a.overlaps(b) != truth;
    let [f32_missed, root_missed] = [squared, root].map(|found| truth && !found);
    let [f32_extra, root_extra] = [squared, root].map(|found| found && !truth);
    [true, truth, exact_wrong, f32_missed, f32_extra, root_missed, root_extra].map(u64::from)
}

fn plus(a: [u64; COUNTS.len()], b: [u64; COUNTS.len()]) -> [u64; COUNTS.len()] {
    std::array::from_fn(|at| a[at] + b[at])
}

fn distance_squared(a: &Sphere, b: &Sphere) -> f32 {
    let [x, y, z] = std::array::from_fn(|axis| a.center[axis] - b.center[axis]);
    x * x + y * y + z * z
}

pub fn squared_f32(a: &Sphere, b: &Sphere) -> bool {
    let reach = a.radius + b.radius;
    distance_squared(a, b) <= reach * reach
}

/// Pairs of a family: the random families share `pairs`, each tangent one has a hundredth as many.
pub(super) fn share(family: &Family, pairs: u64) -> u64 {
    let random = ALL.iter().filter(|family| !family.tangent).count() as u64;
    if family.tangent { pairs.div_ceil(100) } else { pairs.div_ceil(random) }
}

pub fn pairs_decided(pairs: u64) -> u64 {
    ALL.iter().map(|family| share(family, pairs)).sum()
}

/// Decides pairs of all families in every way: `pairs` in the random ones together, a hundredth of them in each
/// tangent one. The result depends on the seed, not on the threads, which call `watch` with the number of further
/// decided pairs.
pub fn measure(pairs: u64, seed: u64, watch: impl Fn(u64) + Sync) -> Vec<Fields> {
    let row = |family: &Family| {
        let pairs = share(family, pairs);
        let chunk = |chunk: u64| {
            let mut random = Random::new(seed.wrapping_add(chunk.wrapping_mul(0x9e37_79b9)));
            let decided = CHUNK.min(pairs - chunk * CHUNK);
            let pair = |_| {
                let (a, b) = (family.make)(&mut random);
                judged(&a, &b)
            };
            let counts = (0..decided).map(pair).fold([0; COUNTS.len()], plus);
            watch(decided);
            counts
        };
        let chunks = (0..pairs.div_ceil(CHUNK)).into_par_iter().map(chunk);
        let counts = chunks.reduce(|| [0; COUNTS.len()], plus);
        let mut row = row!(family: family.name);
        let counts = COUNTS.iter().zip(counts);
        row.extend(counts.map(|(name, count)| ((*name).to_owned(), count.into())));
        row
    };
    ALL.iter().map(row).collect()
}

/// Pairs of a family that are culled together, as one scene of twice as many spheres: 499,500 pairs. The CPU
/// decides all of them, too, which takes most of the time.
const SCENE_PAIRS: u64 = 500;
/// Scenes that the CPU decides side by side: 16 MB of masks.
const SCENES: u64 = 256;

struct Decided {
    spheres: Vec<Sphere>,
    words: Vec<u32>,
    /// Whether sphere 2i overlaps sphere 2i + 1, by exact arithmetic.
    truth: Vec<bool>,
}

fn dense_words(spheres: &[Sphere], reply: &HeapReply) -> Vec<u32> {
    let words = BoxCount::new(spheres.len() as u32).dense_words() as usize;
    reply.words()[..words].to_vec()
}

/// The same on a GPU, with all pairs of the scenes beside them.
pub fn on_gpu(gpu: &Arc<Gpu>, pairs: u64, seed: u64, watch: impl Fn(u64)) -> Result<Vec<Fields>> {
    let mut engine = AllPairs::new(gpu, EngineOptions::default())?;
    let mut reply = HeapReply::new();
    let mut rows = Vec::new();
    for family in ALL {
        let share = share(family, pairs);
        let (mut wrong, mut beside, mut beside_wrong) = (0, 0, 0);
        let decide = |scene: u64| -> Result<Decided, CullError> {
            let pairs = SCENE_PAIRS.min(share - scene * SCENE_PAIRS);
            let mut random = Random::new(seed.wrapping_add(scene.wrapping_mul(0x9e37_79b9)));
            let (mut spheres, mut truth) = (Vec::new(), Vec::new());
            for _ in 0..pairs {
                let (a, b) = (family.make)(&mut random);
                truth.push(overlap(&a, &b));
                spheres.extend([a, b]);
            }
            let mut reply = HeapReply::new();
            let input = CullInput::spheres(&spheres).encoding(Encoding::Dense);
            SphereAllPairs::new().cull(&input, &mut reply)?;
            let words = dense_words(&spheres, &reply);
            Ok(Decided { spheres, words, truth })
        };
        let scenes = share.div_ceil(SCENE_PAIRS);
        for first in (0..scenes).step_by(SCENES as usize) {
            let batch = (first..scenes.min(first + SCENES)).into_par_iter().map(decide);
            for Decided { spheres, words, truth } in batch.collect::<Result<Vec<_>, _>>()? {
                let objects = Objects::Spheres(&spheres);
                engine.cull_objects(objects, Encoding::Dense, &mut reply)?;
                let on_gpu = dense_words(&spheres, &reply);
                let n = BoxCount::new(spheres.len() as u32);
                let is_wrong = |(is_pair, first): &(&bool, u32)| {
                    let is_set = |k: u64| on_gpu[(k / 32) as usize] >> (k % 32) & 1 == 1;
                    let k = PairIndex::of(n, *first, first + 1);
                    k.is_some_and(|k| is_set(k.get())) != **is_pair
                };
                wrong += truth.iter().zip((0..).step_by(2)).filter(is_wrong).count();
                let differs = words.iter().zip(&on_gpu).map(|(cpu, gpu)| (cpu ^ gpu).count_ones());
                beside_wrong += differs.map(u64::from).sum::<u64>();
                beside += n.pair_count();
                watch(truth.len() as u64);
            }
        }
        rows.push(row!(family: family.name, pairs: share, wrong, beside, beside_wrong));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn the_exact_way_is_never_wrong_and_f32_is() {
        let watched = AtomicU64::new(0);
        let watch = |pairs| {
            watched.fetch_add(pairs, Ordering::Relaxed);
        };
        let rows = measure(60_000, 5, watch);
        assert_eq!(watched.into_inner(), pairs_decided(60_000));
        assert_eq!(
            rows.iter().filter_map(|row| row["pairs"].as_u64()).sum::<u64>(),
            pairs_decided(60_000)
        );
        for row in rows {
            assert_eq!(row["exact_wrong"], 0, "{row:?}");
            let share = row["overlapping"].as_f64().zip(row["pairs"].as_f64()).map(|(a, b)| a / b);
            let has_both = share.is_some_and(|share| (0.05..0.95).contains(&share));
            assert!(has_both || row["family"] == "tangent", "{row:?}");
            if row["family"] == "near ties" || row["family"] == "tangent but for an ulp" {
                let is_exact = row["f32_missed"] == 0 && row["f32_extra"] == 0;
                assert!(!is_exact, "nothing was hard: {row:?}");
            }
        }
    }
}
