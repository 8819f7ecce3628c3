//! Times of the grid's stages on a device, and of whole frames by the host's clock.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::{
    CullError, CullInput, CullReport, EngineName, HeapReply, Isa, cpu_engine,
};
use pairmask_core::mask::{MaskShape, MaskView};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_shaders::Found;
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Capacity, Gpu, Grid, GridOptions, GridUnderWay, SUBMISSIONS,
    SharedImports, Sizes, cell_count, first_capacity,
};
use pairmaskd::scene::{Scene, SceneName};

use super::scenes::PairSum;
use super::shared::{FrameSegments, Rig};
use super::wrong_pairs;
use crate::Result;
use crate::study::harness::table::{Fields, row};
use crate::study::harness::{median, percentile, repeated};

pub const SCENES: [SceneName; 4] =
    [SceneName::Uniform, SceneName::Mixed, SceneName::Pile, SceneName::Plane];

const LEAST_FRAMES: usize = 3;
const ROUNDS: usize = 16;
/// Mask words a box that the reply has room for.
const WORDS_A_BOX: u64 = 20;

/// Measures a scene in motion, then the stages by an engine that times them. The first and the last mask are compared
/// with the CPU's.
pub fn measure(gpu: &Arc<Gpu>, name: SceneName, n: u32, budget: Duration) -> Result<Fields> {
    let mut scene = Scene::new(name, n as usize, 1);
    let mut rig = grid_rig(gpu, scene.boxes(), false)?;
    let mut report = rig.frame()?;
    compare(&rig, &report, &scene, name)?;
    let mut times = Vec::new();
    let started = Instant::now();
    // A device that waits for the next frame's boxes lowers its clocks. So each step runs a few
    // frames of the same boxes and measures the last. Sorting does not depend on the last frame's
    // order, so a frame of unmoved boxes costs as much as one of moved boxes.
    while times.len() < LEAST_FRAMES || started.elapsed() < budget {
        scene.step();
        rig.memory.boxes.write(scene.boxes());
        for round in 0..ROUNDS {
            let start = Instant::now();
            report = rig.frame()?;
            if round > ROUNDS / 2 {
                times.push(start.elapsed().as_secs_f64() * 1e6);
            }
        }
    }
    compare(&rig, &report, &scene, name)?;
    let MaskShape::Sparse { bits, .. } = report.shape else { return Err(wrong_pairs(n, name)) };
    let (imported, frames) = (rig.memory.imported, times.len());
    drop(rig);
    let stage_us = stages(gpu, &mut scene, budget / 2)?;
    Ok(row!(
        scene: name.as_str(),
        n,
        encoding: Encoding::Sparse.as_str(),
        pairs: report.pair_count,
        words: bits.len,
        cells: cell_count(scene.boxes()),
        compared: BoxCount::new(n).pair_count() - report.skipped.pairs,
        mask_bytes: report.shape.mask_bytes(),
        imported,
        gpu_us: stage_us.iter().map(|(_, us)| us).sum::<f64>(),
        stage_us,
        frame_us: percentile(times.clone(), 50),
        frame_p99_us: percentile(times, 99),
        frames,
        checked: true,
    ))
}

pub(crate) fn grid_rig(gpu: &Arc<Gpu>, boxes: &[Aabb], profiled: bool) -> Result<Rig<Grid>> {
    let imports = SharedImports::default();
    let options = GridOptions { profiled, imports: imports.clone(), ..GridOptions::default() };
    let memory = FrameSegments::new(gpu, &imports, boxes, reply_words(boxes.len()))?;
    Ok(Rig { engine: Grid::new(gpu, &options)?, memory })
}

pub(crate) fn all_pairs_rig(gpu: &Arc<Gpu>, boxes: &[Aabb]) -> Result<Rig<AllPairs>> {
    let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
    let capacity = first_capacity(Found::Words, n).max(WORDS_A_BOX * u64::from(n.get()));
    let words = MaskShape::exact(Encoding::Sparse, n, capacity, false).extent_words();
    let imports = SharedImports::default();
    let options = AllPairsOptions { imports: imports.clone(), ..AllPairsOptions::default() };
    let memory = FrameSegments::new(gpu, &imports, boxes, words)?;
    Ok(Rig { engine: AllPairs::new(gpu, options)?, memory })
}

/// Median of frames of unmoved boxes on a warm device, by the host's clock, µs.
pub(crate) fn median_us(rig: &mut Rig<impl Engine>, budget: Duration) -> Result<f64> {
    let mut times = repeated(budget, ROUNDS, || {
        let start = Instant::now();
        rig.frame()?;
        Ok::<_, CullError>(start.elapsed().as_secs_f64() * 1e6)
    })?;
    // The first half warms up.
    Ok(median(times.split_off(times.len() / 2)))
}

pub fn frames_a_second(
    gpu: &Arc<Gpu>,
    boxes: &[Aabb],
    under_way: usize,
    budget: Duration,
) -> Result<f64> {
    let imports = SharedImports::default();
    let options = GridOptions { imports: imports.clone(), ..GridOptions::default() };
    let mut grid = Grid::new(gpu, &options)?;
    let mut under_way_now = VecDeque::new();
    for _ in 0..under_way.clamp(1, SUBMISSIONS) {
        let memory = FrameSegments::new(gpu, &imports, boxes, reply_words(boxes.len()))?;
        under_way_now.push_back(begin(&mut grid, memory)?);
    }
    let (mut frames, mut started) = (0u32, Instant::now());
    while let Some(frame) = under_way_now.pop_front() {
        let (ended, memory) = grid.end(frame);
        ended?;
        frames += 1;
        if frames < ROUNDS as u32 {
            // The first part allocates blocks, records frames and raises clocks.
            started = Instant::now();
        } else if started.elapsed() > budget && frames > 2 * ROUNDS as u32 {
            break;
        }
        if let Some(memory) = memory {
            under_way_now.push_back(begin(&mut grid, memory)?);
        }
    }
    Ok(f64::from(frames - ROUNDS as u32) / started.elapsed().as_secs_f64())
}

fn begin(grid: &mut Grid, memory: FrameSegments) -> Result<GridUnderWay<FrameSegments>> {
    Ok(grid.begin(memory, Encoding::Sparse).map_err(|(error, _)| error)?)
}

fn reply_words(n: usize) -> u64 {
    let n = BoxCount::of_len(n).unwrap_or_default();
    let items = WORDS_A_BOX * u64::from(n.get());
    Sizes::of(n).reply_words(Capacity { found: Found::Words, items })
}

fn stages(gpu: &Arc<Gpu>, scene: &mut Scene, budget: Duration) -> Result<Vec<(String, f64)>> {
    let mut rig = grid_rig(gpu, scene.boxes(), true)?;
    let mut frame = 0;
    let samples = repeated(budget, ROUNDS, || {
        if frame % ROUNDS == 0 {
            scene.step();
            rig.memory.boxes.write(scene.boxes());
        }
        rig.frame()?;
        frame += 1;
        Ok::<_, CullError>(rig.engine.step_times().to_vec())
    })?;
    // The first half of the frames of the same boxes warms up.
    let warm = || samples.chunks(ROUNDS).flat_map(|round| round.iter().skip(ROUNDS / 2));
    let labels = samples[0].iter().map(|step| step.label);
    let us = |at: usize| warm().filter_map(|steps| Some(steps.get(at)?.ns / 1e3)).collect();
    Ok(labels.enumerate().map(|(at, label)| (label.to_owned(), median(us(at)))).collect())
}

/// Compares the pairs with those of the CPU's grid: counts, and a hash that does not depend on the
/// order.
fn compare<E>(rig: &Rig<E>, report: &CullReport, scene: &Scene, name: SceneName) -> Result<()> {
    let n = BoxCount::of_len(scene.boxes().len()).unwrap_or_default();
    let threads = rayon::current_num_threads();
    let mut reply = HeapReply::new();
    let truth = cpu_engine(EngineName::CpuGrid, Isa::best())?
        .cull(&CullInput::boxes(scene.boxes()).threads(threads), &mut reply)?;
    let ours = pair_sum(n, report, rig.memory.reply.words());
    let same = ours.is_some()
        && ours == pair_sum(n, &truth, reply.words())
        && report.pair_count == truth.pair_count
        && report.census == truth.census;
    if same { Ok(()) } else { Err(wrong_pairs(n.get(), name)) }
}

/// Number and sum of the pairs of a mask; `None` for a malformed one.
fn pair_sum(n: BoxCount, report: &CullReport, words: &[u32]) -> Option<PairSum> {
    let view = MaskView::new(n, &report.shape, words).ok()?;
    view.verify().ok()?;
    let mut sum = PairSum::default();
    view.for_each(|a, b| sum.add([a, b]));
    Some(sum)
}
