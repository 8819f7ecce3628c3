//! Frames of spheres, timed.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullError, CullInput, HeapReply};
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{Encoding, EncodingChoice};
use pairmaskd::scene::{Scene, SceneName};

use super::errors::squared_f32;
use super::papers_row;
use crate::study::harness::median_ms;
use crate::study::harness::table::{Fields, row};

/// Numbers of spheres: the paper's, and larger ones.
const SIZES: [usize; 10] = [64, 128, 192, 256, 320, 1_000, 3_200, 10_000, 32_000, 100_000];
const QUICK_SIZES: usize = 6;

/// How long each figure is measured: at least three frames, and this, unless a frame is long.
const BUDGET: Duration = Duration::from_millis(300);

pub fn measure(quick: bool, seed: u64) -> Result<Vec<Fields>, CullError> {
    let sizes = if quick { &SIZES[..QUICK_SIZES] } else { &SIZES[..] };
    let budget = if quick { BUDGET / 30 } else { BUDGET };
    sizes.iter().map(|n| row(*n, budget, seed)).collect()
}

/// Spheres in the boxes of a uniform scene: about half a pair a sphere.
pub fn scene(n: usize, seed: u64) -> Vec<Sphere> {
    let inscribed = |b: &pairmask_core::Aabb| {
        let center = std::array::from_fn(|axis| 0.5 * (b.min[axis] + b.max[axis]));
        Sphere::new(center, 0.5 * (b.max[0] - b.min[0]))
    };
    Scene::new(SceneName::Uniform, n, seed).boxes().iter().map(inscribed).collect()
}

fn row(n: usize, budget: Duration, seed: u64) -> Result<Fields, CullError> {
    let spheres = scene(n, seed);
    let (mut reply, mut all_pairs) = (HeapReply::new(), SphereAllPairs::new());
    let mut with = |threads| {
        let input = CullInput::spheres(&spheres).threads(threads);
        timed(budget, || Ok(all_pairs.cull(&input, &mut reply)?.pair_count))
    };
    let (sequential_fps, _) = with(1)?;
    let (parallel_fps, pairs) = with(rayon::current_num_threads())?;
    let mut row = row!(
        n: n as u64,
        pairs,
        plain_fps: plain_fps(&spheres, budget)?,
        sequential_fps,
        parallel_fps,
        speed_up: parallel_fps / sequential_fps,
        engines_fps: by_engines(&spheres, budget)?.0,
    );
    row.extend(papers_row(n));
    Ok(row)
}

pub(super) fn plain_fps(spheres: &[Sphere], budget: Duration) -> Result<f64, CullError> {
    let mut found = Vec::new();
    let plain = || {
        found.clear();
        plain(black_box(spheres), &mut found);
        Ok(found.len() as u64)
    };
    timed(budget, plain).map(|(fps, _)| fps)
}

/// Frames a second, and pairs, of the engines that the library chooses.
pub(super) fn by_engines(spheres: &[Sphere], budget: Duration) -> Result<(f64, u64), CullError> {
    let (mut engines, mut reply) = (SphereEngines::new(), HeapReply::new());
    let encoding = EncodingChoice::Only(Encoding::Sparse);
    let options = CullOptions { encoding, ..CullOptions::default() };
    timed(budget, || Ok(engines.cull(spheres, &options, &mut reply)?.report.pair_count))
}

/// The paper's algorithm 1, without the root: the pairs in a list.
fn plain(spheres: &[Sphere], found: &mut Vec<(u32, u32)>) {
    for (a, one) in spheres.iter().enumerate() {
        for (b, other) in spheres.iter().enumerate().skip(a + 1) {
            if squared_f32(one, other) {
                found.push((a as u32, b as u32));
            }
        }
    }
}

/// A frame that takes longer than this is run once.
const LONG_FRAME: Duration = Duration::from_secs(1);

/// Frames a second, from the median time of a frame, and the pairs of the last one. The first frame, which allocates,
/// counts only if it is long.
pub(super) fn timed(
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
