//! Spheres on a GPU: frames a second beside the CPU's and the paper's, and pairs decided wrongly.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullError, CullInput, CullReport, HeapReply};
use pairmask_core::objects::Objects;
use pairmask_core::sphere::{SPHERE_BYTES, Sphere, SphereAllPairs};
use pairmask_core::{BoxCount, Encoding, EncodingChoice, EngineName, PairIndex};
use pairmaskd::execute::gpu::{AllPairs, AllPairsOptions, Gpu, Grid, GridOptions, SharedImports};
use pairmaskd::scene::Random;
use rayon::prelude::*;
use serde::Serialize;

use super::families::{ALL, Family};
use super::oracle::overlap;
use super::papers_row;
use super::speed::{frames_a_second, plain, scene};
use crate::Result;
use crate::gpu_stages::shared::Segment;
use crate::study::harness::table::{Fields, row};

/// Numbers of spheres: the paper's, and larger ones.
const SIZES: [usize; 11] =
    [64, 128, 192, 256, 320, 1_000, 3_200, 10_000, 32_768, 100_000, 1_000_000];
/// Numbers of a quick look.
const QUICK_SIZES: usize = 7;
/// Up to so many spheres one pair after the other is timed: 10,000 take 50 ms.
const PLAIN_SPHERES: usize = 10_000;
/// Up to so many spheres all pairs is timed: 100,000 take 10 ms on an H200.
const ALL_PAIRS_SPHERES: usize = 100_000;
/// Words a sphere of the memory for replies.
const REPLY_WORDS: usize = 20;

/// Pairs of a family, decided by a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GpuErrorRow {
    pub family: &'static str,
    pub pairs: u64,
    pub wrong: u64,
    pub beside: u64,
    pub beside_wrong: u64,
}

/// The answer before the first frame.
const NOT_RUN: Result<CullReport, CullError> =
    Err(CullError::DeviceLost { engine: EngineName::GpuGrid });

pub fn measure(gpu: &Arc<Gpu>, quick: bool, seed: u64) -> Result<Vec<Fields>> {
    let sizes = if quick { &SIZES[..QUICK_SIZES] } else { &SIZES[..] };
    let budget = Duration::from_millis(if quick { 20 } else { 500 });
    sizes.iter().map(|n| timed(gpu, *n, budget, seed)).collect()
}

fn timed(gpu: &Arc<Gpu>, n: usize, budget: Duration, seed: u64) -> Result<Fields> {
    let objects = scene(n, seed);
    let mut spheres = Segment::new(n * SPHERE_BYTES)?;
    let mut reply = Segment::new(4 * REPLY_WORDS * n.max(1_000))?;
    let imports = SharedImports::default();
    let mut imported = true;
    for segment in [&mut spheres, &mut reply] {
        imported &= segment.import(gpu, &imports).is_ok();
    }
    spheres.write(&objects);
    let encoding = Encoding::Sparse;

    let options = GridOptions { imports: imports.clone(), ..GridOptions::default() };
    let mut grid = Grid::new(gpu, &options)?;
    let mut culled = NOT_RUN;
    let grid_fps = frames_a_second(budget, || {
        culled = grid.cull_objects(Objects::Spheres(spheres.objects(n)), encoding, &mut reply);
    });
    let pairs = culled?.pair_count;
    let mut counts = vec![pairs];

    let mut all_pairs_fps = None;
    let mut tests_a_second = None;
    if n <= ALL_PAIRS_SPHERES {
        let options =
            AllPairsOptions { imports: imports.clone(), profiled: true, ..Default::default() };
        let mut all_pairs = AllPairs::new(gpu, options)?;
        let mut stage_ns = f64::INFINITY;
        let mut culled = NOT_RUN;
        all_pairs_fps = Some(frames_a_second(budget, || {
            culled =
                all_pairs.cull_objects(Objects::Spheres(spheres.objects(n)), encoding, &mut reply);
            let steps = all_pairs.step_times().iter().filter(|step| step.label == "pairs");
            stage_ns = stage_ns.min(steps.map(|step| step.ns).sum());
        }));
        counts.push(culled?.pair_count);
        let tests = BoxCount::new(n as u32).pair_count() as f64;
        tests_a_second = Some(tests / (1e-9 * stage_ns));
    }

    let (mut engines, mut heap) = (SphereEngines::new(), HeapReply::new());
    let options =
        CullOptions { encoding: EncodingChoice::Only(encoding), ..CullOptions::default() };
    let mut culled: Result<u64, CullError> = Ok(0);
    let cpu_fps = frames_a_second(budget, || {
        culled = engines.cull(&objects, &options, &mut heap).map(|a| a.report.pair_count);
    });
    counts.push(culled?);
    let plain_fps = (n <= PLAIN_SPHERES).then(|| {
        let mut found = Vec::new();
        frames_a_second(budget, || {
            found.clear();
            plain(black_box(&objects), &mut found);
        })
    });
    let [paper_sequential_fps, paper_parallel_fps, paper_speed_up] = papers_row(n);
    Ok(row!(
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
        paper_sequential_fps,
        paper_parallel_fps,
        paper_speed_up,
    ))
}

/// Pairs of a family that are culled together, as one scene of twice as many spheres: 499,500 pairs. The CPU
/// decides all of them, too, which takes most of the time.
const SCENE_PAIRS: u64 = 500;
/// Scenes that the CPU decides side by side, while the GPU decides as many others: 16 MB of masks.
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

impl GpuErrorRow {
    fn note(&mut self, scene: &Decided, gpu: &[u32]) {
        let n = BoxCount::new(scene.spheres.len() as u32);
        self.pairs += scene.truth.len() as u64;
        self.beside += n.pair_count();
        let differs =
            scene.words.iter().zip(gpu).map(|(cpu, gpu)| u64::from((cpu ^ gpu).count_ones()));
        self.beside_wrong += differs.sum::<u64>();
        for (is_pair, first) in scene.truth.iter().zip((0..).step_by(2)) {
            let said = PairIndex::of(n, first, first + 1)
                .is_some_and(|k| gpu[(k.get() / 32) as usize] >> (k.get() % 32) & 1 == 1);
            self.wrong += u64::from(said != *is_pair);
        }
    }
}

/// Has a GPU decide `pairs` random pairs of all families together, and a hundredth of them in each tangent
/// one, with all pairs beside them. `watch` is called with the number of further decided pairs of
/// the families.
pub fn count_errors(
    gpu: &Arc<Gpu>,
    pairs: u64,
    seed: u64,
    watch: impl Fn(u64) + Sync,
) -> Result<Vec<GpuErrorRow>> {
    let mut engine = AllPairs::new(gpu, AllPairsOptions::default())?;
    let mut reply = HeapReply::new();
    let mut rows = Vec::new();
    for family in ALL {
        let share = super::errors::share(family, pairs);
        let mut row = GpuErrorRow { family: family.name, ..GpuErrorRow::default() };
        let scenes = share.div_ceil(SCENE_PAIRS);
        let make = |scene: u64| {
            let pairs = SCENE_PAIRS.min(share - scene * SCENE_PAIRS);
            decided(family, pairs, seed.wrapping_add(scene.wrapping_mul(0x9e37_79b9)))
        };
        let batch_from = |first: u64| -> Result<Vec<Decided>, CullError> {
            (first..scenes.min(first + SCENES)).into_par_iter().map(make).collect()
        };
        let mut batch = batch_from(0)?;
        let mut next = SCENES;
        while !batch.is_empty() {
            let on_gpu = || -> Result<(), CullError> {
                for scene in &batch {
                    engine.cull_objects(
                        Objects::Spheres(&scene.spheres),
                        Encoding::Dense,
                        &mut reply,
                    )?;
                    row.note(scene, &dense_words(&scene.spheres, &reply));
                    watch(scene.truth.len() as u64);
                }
                Ok(())
            };
            let (compared, made) = rayon::join(on_gpu, || batch_from(next.min(scenes)));
            compared?;
            batch = made?;
            next += SCENES;
        }
        rows.push(row);
    }
    Ok(rows)
}
