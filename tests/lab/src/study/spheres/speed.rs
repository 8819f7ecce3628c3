//! Frames of spheres a second, on the CPU and on a GPU, beside the paper's.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullError, CullInput, HeapReply};
use pairmask_core::objects::Objects;
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{Aabb, BoxCount, Encoding, EncodingChoice};
use pairmaskd::execute::gpu::{AllPairs, EngineOptions, Gpu, Grid, SharedImports};
use pairmaskd::scene::{Scene, SceneName};

use super::errors::squared_f32;
use crate::Result;
use crate::gpu_stages::shared::FrameSegments;
use crate::study::harness::{Fields, median_ms, row};
use crate::study::papers::figure;

/// The paper's numbers of spheres, and larger ones on a CPU and on a GPU; `quick` ones go up to some.
const SIZES: [usize; 5] = [64, 128, 192, 256, 320];
const ON_CPU: [usize; 5] = [1_000, 3_200, 10_000, 32_000, 100_000];
const ON_GPU: [usize; 6] = [1_000, 3_200, 10_000, 32_768, 100_000, 1_000_000];

/// Up to so many spheres one pair after the other is timed: 10,000 take 50 ms.
const PLAIN_SPHERES: usize = 10_000;
/// Up to so many spheres all pairs is timed: 100,000 take 10 ms on an H200.
const ALL_PAIRS_SPHERES: usize = 100_000;
const REPLY_WORDS: usize = 20;

/// Rows of the CPU, or of a GPU. Each figure is measured for at least three frames, and a budget of time, unless a frame
/// is long.
pub fn measure(gpu: Option<&Arc<Gpu>>, quick: bool, seed: u64) -> Result<Vec<Fields>> {
    let larger = match (gpu, quick) {
        (None, true) => &ON_CPU[..1],
        (None, false) => &ON_CPU,
        (Some(_), true) => &ON_GPU[..2],
        (Some(_), false) => &ON_GPU,
    };
    let row = |n: &usize| {
        // Spheres in the boxes of a uniform scene: about half a pair a sphere.
        let inscribed = |b: &Aabb| {
            let center = std::array::from_fn(|axis| 0.5 * (b.min[axis] + b.max[axis]));
            Sphere::new(center, 0.5 * (b.max[0] - b.min[0]))
        };
        let scene = Scene::new(SceneName::Uniform, *n, seed);
        let spheres: Vec<Sphere> = scene.boxes().iter().map(inscribed).collect();
        let mut row = match gpu {
            None => row(&spheres, Duration::from_millis(if quick { 10 } else { 300 })),
            Some(gpu) => {
                row_on_gpu(gpu, &spheres, Duration::from_millis(if quick { 20 } else { 500 }))
            }
        }?;
        let paper = |column: &str| figure(&format!("spheres[n={n}].{column}"));
        row.extend(row!(
            paper_sequential_fps: paper("sequential"),
            paper_parallel_fps: paper("parallel"),
            paper_speed_up: paper("speed_up"),
        ));
        Ok(row)
    };
    SIZES.iter().chain(larger).map(row).collect()
}

fn row(spheres: &[Sphere], budget: Duration) -> Result<Fields> {
    let (mut reply, mut all_pairs) = (HeapReply::new(), SphereAllPairs::new());
    let mut with = |threads| {
        let input = CullInput::spheres(spheres).threads(threads);
        timed(budget, || Ok(all_pairs.cull(&input, &mut reply)?.pair_count))
    };
    let (sequential_fps, _) = with(1)?;
    let (parallel_fps, pairs) = with(rayon::current_num_threads())?;
    Ok(row!(
        n: spheres.len(),
        pairs,
        plain_fps: plain_fps(spheres, budget)?,
        sequential_fps,
        parallel_fps,
        speed_up: parallel_fps / sequential_fps,
        engines_fps: by_engines(spheres, budget)?.0,
    ))
}

fn row_on_gpu(gpu: &Arc<Gpu>, objects: &[Sphere], budget: Duration) -> Result<Fields> {
    let n = objects.len();
    let imports = SharedImports::default();
    let words = (REPLY_WORDS * n.max(1_000)) as u64;
    let memory = FrameSegments::new(gpu, &imports, objects, words)?;
    let FrameSegments { boxes: spheres, mut reply, imported, .. } = memory;
    let encoding = Encoding::Sparse;

    let options = EngineOptions { imports: imports.clone(), ..EngineOptions::default() };
    let mut grid = Grid::new(gpu, &options)?;
    let objects_of = || Objects::Spheres(spheres.objects(n));
    let by_grid = || Ok(grid.cull_objects(objects_of(), encoding, &mut reply)?.pair_count);
    let (grid_fps, pairs) = timed(budget, by_grid)?;
    let mut counts = vec![pairs];

    let (mut all_pairs_fps, mut tests_a_second) = (None, None);
    if n <= ALL_PAIRS_SPHERES {
        let options =
            EngineOptions { imports: imports.clone(), profiled: true, ..Default::default() };
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

    let (cpu_fps, count) = by_engines(objects, budget)?;
    counts.push(count);
    let plain = (n <= PLAIN_SPHERES).then(|| plain_fps(objects, budget));
    let plain_fps = plain.transpose()?;
    Ok(row!(
        n,
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
    ))
}

/// The paper's algorithm 1, without the root: the pairs in a list.
fn plain_fps(spheres: &[Sphere], budget: Duration) -> Result<f64, CullError> {
    let mut found = Vec::new();
    let plain = || {
        found.clear();
        let spheres = black_box(spheres);
        for (a, one) in spheres.iter().enumerate() {
            for (b, other) in spheres.iter().enumerate().skip(a + 1) {
                if squared_f32(one, other) {
                    found.push((a as u32, b as u32));
                }
            }
        }
        Ok(found.len() as u64)
    };
    timed(budget, plain).map(|(fps, _)| fps)
}

/// Frames a second, and pairs, of the engines that the library chooses.
fn by_engines(spheres: &[Sphere], budget: Duration) -> Result<(f64, u64), CullError> {
    let (mut engines, mut reply) = (SphereEngines::new(), HeapReply::new());
    let encoding = EncodingChoice::Only(Encoding::Sparse);
    let options = CullOptions { encoding, ..CullOptions::default() };
    timed(budget, || Ok(engines.cull(spheres, &options, &mut reply)?.report.pair_count))
}

/// A frame that takes longer than this is run once.
const LONG_FRAME: Duration = Duration::from_secs(1);

/// Frames a second, from the median time of a frame, and the pairs of the last one. The first frame, which allocates,
/// counts only if it is long.
fn timed(
    budget: Duration,
    mut frame: impl FnMut() -> Result<u64, CullError>,
) -> Result<(f64, u64), CullError> {
    let start = Instant::now();
    let mut pairs = frame();
    let first = start.elapsed().as_secs_f64();
    if first >= LONG_FRAME.as_secs_f64() {
        return Ok((1.0 / first, pairs?));
    }
    let ms = median_ms(budget, || pairs = black_box(frame()));
    Ok((1e3 / ms.max(1e-6), pairs?))
}
