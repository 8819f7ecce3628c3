//! Times of the grid's stages on a device, and of whole frames by the host's clock.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, Grid as CpuGrid, HeapReply};
use pairmask_core::mask::{MaskShape, MaskView};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_shaders::Found;
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Capacity, Counted, Gpu, Grid, GridOptions, GridUnderWay,
    SUBMISSIONS, SharedImports, Sizes, cell_count,
};
use pairmaskd::scene::{Scene, SceneName};
use serde::Serialize;

use super::scenes::PairSum;
use super::shared::{Rig, Segment, SegmentFrame, Stepped};
use super::{LEAST_FRAMES, wrong_pairs};
use crate::Result;
use crate::study::harness::{median, percentile, repeated};

/// The scenes of the anchors.
pub const SCENES: [SceneName; 4] =
    [SceneName::Uniform, SceneName::Mixed, SceneName::Pile, SceneName::Plane];

/// Frames from the same boxes.
const ROUNDS: usize = 16;
/// Mask words a box that the reply has room for: 30 pairs of a list.
const WORDS_A_BOX: u64 = 20;

/// A scene's measurement.
#[derive(Clone, Debug, Serialize)]
pub struct GridRow {
    pub scene: String,
    pub n: u32,
    pub encoding: &'static str,
    pub pairs: u64,
    pub words: u64,
    pub compared: u64,
    pub cells: u32,
    pub mask_bytes: u64,
    pub imported: bool,
    pub stage_us: Vec<(String, f64)>,
    pub gpu_us: f64,
    pub frame_us: f64,
    pub frame_p99_us: f64,
    pub frames: usize,
    pub checked: bool,
}

pub fn measure(
    gpu: &Arc<Gpu>,
    name: SceneName,
    n: u32,
    encoding: Encoding,
    budget: Duration,
    check: bool,
) -> Result<GridRow> {
    let rig = |boxes: &[Aabb], profiled| grid_rig(gpu, boxes, encoding, profiled);
    measure_with(rig, name, n, encoding, budget, check)
}

/// Measures a scene in motion by the engine of a rig, which tells times of its stages where it is profiled.
pub(super) fn measure_with<E: Stepped>(
    new_rig: impl Fn(&[Aabb], bool) -> Result<Rig<E>>,
    name: SceneName,
    n: u32,
    encoding: Encoding,
    budget: Duration,
    check: bool,
) -> Result<GridRow> {
    let mut scene = Scene::new(name, n as usize, 1);
    let mut rig = new_rig(scene.boxes(), false)?;
    let mut report = rig.frame()?;
    if check {
        compare(&rig, &report, &scene, name)?;
    }
    let mut times = Vec::new();
    let started = Instant::now();
    // A device that waits for the next frame's boxes lowers its clocks. So each step runs a few
    // frames of the same boxes and measures the last. Sorting does not depend on the last frame's
    // order, so a frame of unmoved boxes costs as much as one of moved boxes.
    while times.len() < LEAST_FRAMES || started.elapsed() < budget {
        scene.step();
        rig.boxes.write(scene.boxes());
        for round in 0..ROUNDS {
            let start = Instant::now();
            report = rig.frame()?;
            if round > ROUNDS / 2 {
                times.push(start.elapsed().as_secs_f64() * 1e6);
            }
        }
    }
    if check {
        compare(&rig, &report, &scene, name)?;
    }
    let words = match report.shape {
        MaskShape::Sparse { bits, .. } => bits.len,
        _ => 0,
    };
    let imported = rig.imported;
    let frames = times.len();
    let (frame_us, frame_p99_us) = (percentile(times.clone(), 50), percentile(times, 99));
    drop(rig);
    let stage_us = stages(new_rig(scene.boxes(), true)?, &mut scene, budget / 2)?;
    Ok(GridRow {
        scene: name.to_string(),
        n,
        encoding: encoding.as_str(),
        pairs: report.pair_count,
        words,
        cells: cell_count(scene.boxes()),
        compared: BoxCount::new(n).pair_count() - report.skipped.pairs,
        mask_bytes: report.shape.mask_bytes(),
        imported,
        gpu_us: stage_us.iter().map(|(_, us)| us).sum(),
        stage_us,
        frame_us,
        frame_p99_us,
        frames,
        checked: check,
    })
}

/// The grid with boxes and replies in shared memory.
pub(crate) fn grid_rig(
    gpu: &Arc<Gpu>,
    boxes: &[Aabb],
    encoding: Encoding,
    profiled: bool,
) -> Result<Rig<Grid>> {
    let imports = SharedImports::default();
    let options = GridOptions { profiled, imports: imports.clone(), ..GridOptions::default() };
    let words = reply_words(boxes.len());
    Rig::new(Grid::new(gpu, &options)?, gpu, Some(&imports), boxes, words, encoding)
}

/// All pairs in the same way, where the driver imports memory and `imported`.
pub(crate) fn all_pairs_rig(
    gpu: &Arc<Gpu>,
    with: &AllPairsOptions,
    imported: bool,
    boxes: &[Aabb],
    encoding: Encoding,
    profiled: bool,
) -> Result<Rig<AllPairs>> {
    let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
    let capacity = Counted::Sparse.first_capacity(n).max(WORDS_A_BOX * u64::from(n.get()));
    let words = MaskShape::exact(encoding, n, capacity, false).extent_words();
    let imports = SharedImports::default();
    let with = AllPairsOptions { profiled, imports: imports.clone(), ..with.clone() };
    let engine = AllPairs::new(gpu, with)?;
    Rig::new(engine, gpu, imported.then_some(&imports), boxes, words, encoding)
}

/// Median of frames of unmoved boxes on a warm device, by the host's clock, µs.
pub(crate) fn median_us(rig: &mut Rig<impl Stepped>, budget: Duration) -> Result<f64> {
    let mut times = repeated(budget, ROUNDS, || {
        let start = Instant::now();
        rig.frame()?;
        Ok::<_, CullError>(start.elapsed().as_secs_f64() * 1e6)
    })?;
    // The first half warms up.
    Ok(median(times.split_off(times.len() / 2)))
}

/// Frames a second of unmoved boxes, with 1 or 2 frames under way at a time.
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
        let mut memory = SegmentFrame {
            n: boxes.len(),
            boxes: Segment::new(size_of_val(boxes))?,
            reply: Segment::new(4 * reply_words(boxes.len()) as usize)?,
        };
        for segment in [&mut memory.boxes, &mut memory.reply] {
            if let Err(error) = segment.import(gpu, &imports) {
                log::warn!("staged: {error}");
            }
        }
        memory.boxes.write(boxes);
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

fn begin(grid: &mut Grid, memory: SegmentFrame) -> Result<GridUnderWay<SegmentFrame>> {
    Ok(grid.begin(memory, Encoding::Sparse).map_err(|(error, _)| error)?)
}

/// Words of a reply that every scene of the bench fits in.
fn reply_words(n: usize) -> u64 {
    let n = BoxCount::of_len(n).unwrap_or_default();
    let items = WORDS_A_BOX * u64::from(n.get());
    Sizes::of(n).reply_words(Capacity { found: Found::Words, items })
}

/// GPU time by stage, medians, µs.
fn stages(
    mut rig: Rig<impl Stepped>,
    scene: &mut Scene,
    budget: Duration,
) -> Result<Vec<(String, f64)>> {
    let mut times: Vec<(String, Vec<f64>)> = Vec::new();
    let started = Instant::now();
    let mut frames = 0;
    while times.first().is_none_or(|(_, us)| us.len() < LEAST_FRAMES) || started.elapsed() < budget
    {
        if frames % ROUNDS == 0 {
            scene.step();
            rig.boxes.write(scene.boxes());
        }
        rig.frame()?;
        frames += 1;
        if frames % ROUNDS <= ROUNDS / 2 {
            continue;
        }
        for (place, step) in rig.engine.step_times().iter().enumerate() {
            if times.len() <= place {
                times.push((step.label.to_owned(), Vec::new()));
            }
            times[place].1.push(step.ns / 1e3);
        }
    }
    Ok(times.into_iter().map(|(label, us)| (label, percentile(us, 50))).collect())
}

/// Compares the pairs with those of the CPU's grid: counts, and a hash that does not depend on the
/// order.
fn compare<E>(rig: &Rig<E>, report: &CullReport, scene: &Scene, name: SceneName) -> Result<()> {
    let n = BoxCount::of_len(scene.boxes().len()).unwrap_or_default();
    let threads = rayon::current_num_threads();
    let mut reply = HeapReply::new();
    let truth =
        CpuGrid::new().cull(&CullInput::boxes(scene.boxes()).threads(threads), &mut reply)?;
    let ours = pair_sum(n, report, rig.reply.words());
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
