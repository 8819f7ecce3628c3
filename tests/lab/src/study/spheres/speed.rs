//! Frames of spheres, timed.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullInput, HeapReply};
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

pub fn measure(quick: bool, seed: u64) -> Vec<Fields> {
    let sizes = if quick { &SIZES[..QUICK_SIZES] } else { &SIZES[..] };
    let budget = if quick { BUDGET / 30 } else { BUDGET };
    sizes.iter().map(|n| timed(*n, budget, seed)).collect()
}

/// Spheres in the boxes of a uniform scene: about half a pair a sphere.
pub fn scene(n: usize, seed: u64) -> Vec<Sphere> {
    let inscribed = |b: &pairmask_core::Aabb| {
        let center = std::array::from_fn(|axis| 0.5 * (b.min[axis] + b.max[axis]));
        Sphere::new(center, 0.5 * (b.max[0] - b.min[0]))
    };
    Scene::new(SceneName::Uniform, n, seed).boxes().iter().map(inscribed).collect()
}

fn timed(n: usize, budget: Duration, seed: u64) -> Fields {
    let spheres = scene(n, seed);
    let mut reply = HeapReply::new();
    let mut all_pairs = SphereAllPairs::new();
    let mut pairs = 0;
    let mut with = |threads| {
        frames_a_second(budget, || {
            // Heap memory does not run out at this size; a report of 0 pairs would show it.
            pairs = all_pairs
                .cull(&CullInput::spheres(&spheres).threads(threads), &mut reply)
                .map_or(0, |r| r.pair_count);
        })
    };
    let (sequential_fps, parallel_fps) = (with(1), with(rayon::current_num_threads()));
    let mut row = row!(
        n: n as u64,
        pairs,
        plain_fps: plain_fps(&spheres, budget),
        sequential_fps,
        parallel_fps,
        speed_up: parallel_fps / sequential_fps,
        engines_fps: engines_fps(&spheres, budget).0,
    );
    row.extend(papers_row(n));
    row
}

pub(super) fn plain_fps(spheres: &[Sphere], budget: Duration) -> f64 {
    let mut found = Vec::new();
    frames_a_second(budget, || {
        found.clear();
        plain(black_box(spheres), &mut found);
    })
}

pub(super) fn engines_fps(spheres: &[Sphere], budget: Duration) -> (f64, u64) {
    let (mut engines, mut reply, mut pairs) = (SphereEngines::new(), HeapReply::new(), 0);
    let encoding = EncodingChoice::Only(Encoding::Sparse);
    let options = CullOptions { encoding, ..CullOptions::default() };
    let fps = frames_a_second(budget, || {
        let answer = black_box(engines.cull(spheres, &options, &mut reply));
        pairs = answer.map_or(0, |answer| answer.report.pair_count);
    });
    (fps, pairs)
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

/// From the median time of a frame. The first frame, which allocates, counts only if it is long.
pub(super) fn frames_a_second(budget: Duration, mut frame: impl FnMut()) -> f64 {
    let start = Instant::now();
    frame();
    if start.elapsed() >= LONG_FRAME {
        return 1.0 / start.elapsed().as_secs_f64();
    }
    1e3 / median_ms(budget, frame).max(1e-6)
}
