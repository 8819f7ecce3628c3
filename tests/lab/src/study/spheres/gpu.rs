//! Spheres on a GPU: frames a second beside the CPU's and the paper's, and pairs decided wrongly.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::engine::{CullError, CullInput, HeapReply};
use pairmask_core::objects::Objects;
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{BoxCount, Encoding, PairIndex};
use pairmaskd::execute::gpu::{AllPairs, AllPairsOptions, Gpu, Grid, GridOptions, SharedImports};
use pairmaskd::scene::Random;
use rayon::prelude::*;

use super::families::{ALL, Family};
use super::oracle::overlap;
use super::papers_row;
use super::speed::{by_engines, plain_fps, scene, timed};
use crate::Result;
use crate::gpu_stages::shared::FrameSegments;
use crate::study::harness::table::{Fields, row};

/// Numbers of spheres: the paper's, and larger ones.
const SIZES: [usize; 11] =
    [64, 128, 192, 256, 320, 1_000, 3_200, 10_000, 32_768, 100_000, 1_000_000];
const QUICK_SIZES: usize = 7;
/// Up to so many spheres one pair after the other is timed: 10,000 take 50 ms.
const PLAIN_SPHERES: usize = 10_000;
/// Up to so many spheres all pairs is timed: 100,000 take 10 ms on an H200.
const ALL_PAIRS_SPHERES: usize = 100_000;
const REPLY_WORDS: usize = 20;

pub fn measure(gpu: &Arc<Gpu>, quick: bool, seed: u64) -> Result<Vec<Fields>> {
    let sizes = if quick { &SIZES[..QUICK_SIZES] } else { &SIZES[..] };
    let budget = Duration::from_millis(if quick { 20 } else { 500 });
    sizes.iter().map(|n| row(gpu, *n, budget, seed)).collect()
}

fn row(gpu: &Arc<Gpu>, n: usize, budget: Duration, seed: u64) -> Result<Fields> {
    let objects = scene(n, seed);
    let imports = SharedImports::default();
    let words = (REPLY_WORDS * n.max(1_000)) as u64;
    let memory = FrameSegments::new(gpu, &imports, &objects, words)?;
    let FrameSegments { boxes: spheres, mut reply, imported, .. } = memory;
    let encoding = Encoding::Sparse;

    let options = GridOptions { imports: imports.clone(), ..GridOptions::default() };
    let mut grid = Grid::new(gpu, &options)?;
    let objects_of = || Objects::Spheres(spheres.objects(n));
    let by_grid = || Ok(grid.cull_objects(objects_of(), encoding, &mut reply)?.pair_count);
    let (grid_fps, pairs) = timed(budget, by_grid)?;
    let mut counts = vec![pairs];

    let (mut all_pairs_fps, mut tests_a_second) = (None, None);
    if n <= ALL_PAIRS_SPHERES {
        let options =
            AllPairsOptions { imports: imports.clone(), profiled: true, ..Default::default() };
        let mut all_pairs = AllPairs::new(gpu, options)?;
        let mut stage_ns = f64::INFINITY;
        let (fps, count) = timed(budget, || {
            let report = all_pairs.cull_objects(objects_of(), encoding, &mut reply)?;
            let steps = all_pairs.step_times().iter().filter(|step| step.label == "pairs");
            stage_ns = stage_ns.min(steps.map(|step| step.ns).sum());
            Ok(report.pair_count)
        })?;
        counts.push(count);
        all_pairs_fps = Some(fps);
        tests_a_second = Some(BoxCount::new(n as u32).pair_count() as f64 / (1e-9 * stage_ns));
    }

    let (cpu_fps, count) = by_engines(&objects, budget)?;
    counts.push(count);
    let plain = (n <= PLAIN_SPHERES).then(|| plain_fps(&objects, budget));
    let plain_fps = plain.transpose()?;
    let mut row = row!(
        n: n as u64,
        pairs,
        is_right: counts.iter().all(|count| *count == pairs),
        imported,
        all_pairs_fps,
        tests_a_second,
        grid_fps,
        grid_us: 1e6 / grid_fps,
        cpu_fps,
        plain_fps,
        speed_up: all_pairs_fps.zip(plain_fps).map(|(gpu, plain)| gpu / plain),
    );
    row.extend(papers_row(n));
    Ok(row)
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

fn decided(family: &Family, pairs: u64, seed: u64) -> Result<Decided, CullError> {
    let mut random = Random::new(seed);
    let mut spheres = Vec::with_capacity(2 * pairs as usize);
    let mut truth = Vec::with_capacity(pairs as usize);
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
}

fn dense_words(spheres: &[Sphere], reply: &HeapReply) -> Vec<u32> {
    let words = BoxCount::new(spheres.len() as u32).dense_words() as usize;
    reply.words()[..words].to_vec()
}

/// Pairs of the family that were decided otherwise than by exact arithmetic, and all pairs otherwise than by the CPU.
fn wrong(scene: &Decided, gpu: &[u32]) -> [u64; 2] {
    let n = BoxCount::new(scene.spheres.len() as u32);
    let is_wrong = |(is_pair, first): &(&bool, u32)| {
        let said = PairIndex::of(n, *first, first + 1)
            .is_some_and(|k| gpu[(k.get() / 32) as usize] >> (k.get() % 32) & 1 == 1);
        said != **is_pair
    };
    let wrong = scene.truth.iter().zip((0..).step_by(2)).filter(is_wrong).count();
    let differs = scene.words.iter().zip(gpu).map(|(cpu, gpu)| u64::from((cpu ^ gpu).count_ones()));
    [wrong as u64, differs.sum()]
}

/// Has a GPU decide `pairs` random pairs of all families together, and a hundredth of them in each tangent
/// one, with all pairs beside them. `watch` is called with the number of further decided pairs of
/// the families.
pub fn count_errors(
    gpu: &Arc<Gpu>,
    pairs: u64,
    seed: u64,
    watch: impl Fn(u64),
) -> Result<Vec<Fields>> {
    let mut engine = AllPairs::new(gpu, AllPairsOptions::default())?;
    let mut reply = HeapReply::new();
    let mut rows = Vec::new();
    for family in ALL {
        let share = super::errors::share(family, pairs);
        let (mut wrong_pairs, mut beside, mut beside_wrong) = (0, 0, 0);
        let scenes = share.div_ceil(SCENE_PAIRS);
        let make = |scene: u64| {
            let pairs = SCENE_PAIRS.min(share - scene * SCENE_PAIRS);
            decided(family, pairs, seed.wrapping_add(scene.wrapping_mul(0x9e37_79b9)))
        };
        for first in (0..scenes).step_by(SCENES as usize) {
            let batch = (first..scenes.min(first + SCENES)).into_par_iter().map(make);
            for scene in batch.collect::<Result<Vec<Decided>, CullError>>()? {
                engine.cull_objects(
                    Objects::Spheres(&scene.spheres),
                    Encoding::Dense,
                    &mut reply,
                )?;
                let found = wrong(&scene, &dense_words(&scene.spheres, &reply));
                wrong_pairs += found[0];
                beside_wrong += found[1];
                beside += BoxCount::new(scene.spheres.len() as u32).pair_count();
                watch(scene.truth.len() as u64);
            }
        }
        rows.push(row!(
            family: family.name,
            pairs: share,
            wrong: wrong_pairs,
            beside,
            beside_wrong,
        ));
    }
    Ok(rows)
}
