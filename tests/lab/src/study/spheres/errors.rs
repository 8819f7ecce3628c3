//! Errors of ways to decide a pair of spheres, found by exact arithmetic.

use pairmask_core::sphere::Sphere;
use pairmaskd::scene::Random;
use rayon::prelude::*;

use super::families::{ALL, Family};
use super::oracle::overlap;
use crate::study::harness::table::{Fields, row};

const CHUNK: u64 = 10_000;

const COUNTS: [&str; 7] =
    ["pairs", "overlapping", "exact_wrong", "f32_missed", "f32_extra", "root_missed", "root_extra"];

fn judged(a: &Sphere, b: &Sphere) -> [u64; COUNTS.len()] {
    let truth = overlap(a, b);
    let (squared, root) = (squared_f32(a, b), root_f32(a, b));
    let wrong = [truth && !squared, !truth && squared, truth && !root, !truth && root];
    let [f32_missed, f32_extra, root_missed, root_extra] = wrong;
    [true, truth, a.overlaps(b) != truth, f32_missed, f32_extra, root_missed, root_extra]
        .map(u64::from)
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

/// The paper's test (algorithm 1): the distance itself.
pub fn root_f32(a: &Sphere, b: &Sphere) -> bool {
    distance_squared(a, b).sqrt() <= a.radius + b.radius
}

/// Decides `pairs` pairs of a family in every way. The result depends on the seed, not on the
/// threads. The deciding threads call `watch` with the number of further decided pairs.
fn count_errors(family: &Family, pairs: u64, seed: u64, watch: &(impl Fn(u64) + Sync)) -> Fields {
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
    row.extend(COUNTS.iter().zip(counts).map(|(name, count)| ((*name).to_owned(), count.into())));
    row
}

/// Pairs of a family in a study of `pairs`: the random families share them, each tangent one has a
/// hundredth as many.
pub(super) fn share(family: &Family, pairs: u64) -> u64 {
    let random = ALL.iter().filter(|family| !family.tangent).count() as u64;
    if family.tangent { pairs.div_ceil(100) } else { pairs.div_ceil(random) }
}

pub fn pairs_decided(pairs: u64) -> u64 {
    ALL.iter().map(|family| share(family, pairs)).sum()
}

/// All families: `pairs` pairs in the random ones together, a hundredth of them in each tangent one.
/// `watch` is called with the number of further decided pairs.
pub fn measure(pairs: u64, seed: u64, watch: impl Fn(u64) + Sync) -> Vec<Fields> {
    ALL.iter().map(|family| count_errors(family, share(family, pairs), seed, &watch)).collect()
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
            if row["family"] == "near ties" || row["family"] == "tangent but for an ulp" {
                let is_exact = row["f32_missed"] == 0 && row["f32_extra"] == 0;
                assert!(!is_exact, "nothing was hard: {row:?}");
            }
        }
    }
}
