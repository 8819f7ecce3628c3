//! Errors of ways to decide a pair of spheres, found by exact arithmetic.

use pairmask_core::sphere::Sphere;
use pairmaskd::scene::Random;
use rayon::prelude::*;
use serde::Serialize;

use super::families::{ALL, Family};
use super::oracle::overlap;

/// Pairs of one stream of random numbers.
const CHUNK: u64 = 10_000;

/// Errors of one family.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ErrorRow {
    pub family: &'static str,
    pub pairs: u64,
    pub overlapping: u64,
    pub exact_wrong: u64,
    pub f32_missed: u64,
    pub f32_extra: u64,
    pub root_missed: u64,
    pub root_extra: u64,
}

impl ErrorRow {
    fn note(&mut self, a: &Sphere, b: &Sphere) {
        let truth = overlap(a, b);
        self.pairs += 1;
        self.overlapping += u64::from(truth);
        self.exact_wrong += u64::from(a.overlaps(b) != truth);
        let (squared, root) = (squared_f32(a, b), root_f32(a, b));
        self.f32_missed += u64::from(truth && !squared);
        self.f32_extra += u64::from(!truth && squared);
        self.root_missed += u64::from(truth && !root);
        self.root_extra += u64::from(!truth && root);
    }

    fn plus(self, other: Self) -> Self {
        Self {
            family: self.family,
            pairs: self.pairs + other.pairs,
            overlapping: self.overlapping + other.overlapping,
            exact_wrong: self.exact_wrong + other.exact_wrong,
            f32_missed: self.f32_missed + other.f32_missed,
            f32_extra: self.f32_extra + other.f32_extra,
            root_missed: self.root_missed + other.root_missed,
            root_extra: self.root_extra + other.root_extra,
        }
    }
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
pub fn count_errors(
    family: &Family,
    pairs: u64,
    seed: u64,
    watch: &(impl Fn(u64) + Sync),
) -> ErrorRow {
    let empty = || ErrorRow { family: family.name, ..ErrorRow::default() };
    let chunk = |chunk: u64| {
        let mut random = Random::new(seed.wrapping_add(chunk.wrapping_mul(0x9e37_79b9)));
        let mut row = empty();
        for _ in 0..CHUNK.min(pairs - chunk * CHUNK) {
            let (a, b) = (family.make)(&mut random);
            row.note(&a, &b);
        }
        watch(row.pairs);
        row
    };
    (0..pairs.div_ceil(CHUNK)).into_par_iter().map(chunk).reduce(empty, ErrorRow::plus)
}

/// Pairs of a family in a study of `pairs`: the random families share them, each tangent one has a
/// hundredth as many.
pub(super) fn share(family: &Family, pairs: u64) -> u64 {
    let random = ALL.iter().filter(|family| !family.tangent).count() as u64;
    if family.tangent { pairs.div_ceil(100) } else { pairs.div_ceil(random) }
}

/// Pairs that [`measure`] decides.
pub fn pairs_decided(pairs: u64) -> u64 {
    ALL.iter().map(|family| share(family, pairs)).sum()
}

/// All families: `pairs` pairs in the random ones together, a hundredth of them in each tangent one.
/// `watch` is called with the number of further decided pairs.
pub fn measure(pairs: u64, seed: u64, watch: impl Fn(u64) + Sync) -> Vec<ErrorRow> {
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
        assert_eq!(rows.iter().map(|row| row.pairs).sum::<u64>(), pairs_decided(60_000));
        for row in rows {
            assert_eq!(row.exact_wrong, 0, "{row:?}");
            if row.family == "near ties" || row.family == "tangent but for an ulp" {
                assert!(row.f32_missed + row.f32_extra > 0, "nothing was hard: {row:?}");
            }
        }
    }
}
