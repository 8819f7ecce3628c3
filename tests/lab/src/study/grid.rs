//! The grid study: the cost of the grid, stage by stage, and the sizes from which on it pays.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §4 to §6: tables 6 and 7, figures 5 and 6, measured
//! there on an NVIDIA Quadro FX 3600M. Boxes lie in shared memory, the mask comes back there; no
//! daemon is between.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{Quat, Vec3};
use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineName, HeapReply, Isa, cpu_engine,
};
use pairmask_core::mask::{MaskShape, MaskView};
use pairmask_core::precision::BoxSlice;
use pairmask_core::update::{Placement, Transformed};
use pairmask_core::write::par_write_boxes;
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmask_shaders::Found;
use pairmaskd::execute::gpu::{
    AllPairs, Block, Capacity, Checks, Command, EngineOptions, Gpu, GpuChoice, GpuError, Grid,
    GridUnderWay, Home, HostImport, Part as BlockPart, SUBMISSIONS, SharedImports, Sizes,
    first_capacity, grid_layout,
};
use pairmaskd::scene::{Scene, SceneName};

use super::harness::{
    Fields, Part, Report, machine_with, median, median_ms, percentile, repeated, row,
};
use super::mapping::gpu::Bench;
use super::papers::figure;
use crate::Result;
use crate::gpu_stages::scenes::PairSum;
use crate::gpu_stages::shared::{FrameSegments, Rig};
use crate::gpu_stages::wrong_pairs;

const SCENES: [SceneName; 4] =
    [SceneName::Uniform, SceneName::Mixed, SceneName::Pile, SceneName::Plane];
/// The paper's scene: a column of objects of one size falls on a plane.
const PAPER_SCENE: SceneName = SceneName::Cubes;
const SEED: u64 = 1;

/// Boxes of table 7, and between them to find the crossing.
const CROSSING_COUNTS: [u32; 10] =
    [100, 500, 1_000, 2_000, 4_000, 6_000, 8_000, 10_000, 16_000, 32_000];
/// Boxes beyond which the sweep takes seconds.
const SWEEP_MOST: u32 = 1_000_000;

/// Figures of a row of a table of the paper, if it has all of them.
fn paper<const N: usize>(table: &str, n: u32, columns: [&str; N]) -> Option<[f64; N]> {
    let found = columns.map(|column| figure(&format!("{table}[n={n}].{column}")));
    found.iter().all(Option::is_some).then(|| found.map(Option::unwrap_or_default))
}

/// `counts` are the numbers of boxes of table 6, figure 5 and the stages; with `quick` times mean little.
pub fn measure(choice: &GpuChoice, counts: &[u32], quick: bool) -> Result<Report> {
    let gpu = &Gpu::open(choice, HostImport::IfPossible)?;
    let budget = Duration::from_millis(if quick { 50 } else { 500 });
    let bandwidth = bandwidth(gpu)?;
    let [mut scenes, mut stages, mut parts, mut engines] = <[Vec<Fields>; 4]>::default();
    let [mut under_way, mut with_and_without, mut moving] = <[Vec<Fields>; 3]>::default();
    for &n in counts {
        for name in SCENES {
            let row = measure_scene(gpu, name, n, budget)?;
            if name == SceneName::Uniform {
                stages.extend(stages_of(&row, bandwidth));
            }
            scenes.push(row);
        }
        let row = measure_scene(gpu, PAPER_SCENE, n, budget)?;
        parts.push(parts_row(&row, budget));
        engines.push(engines_row(&row, budget));
        let scene = Scene::new(SceneName::Uniform, n as usize, SEED);
        let fps = |under_way| frames_a_second(gpu, scene.boxes(), under_way, budget);
        under_way.push(row!(n, one_fps: fps(1)?, two_fps: fps(2)?));
    }
    let most = if quick { 2_000 } else { u32::MAX };
    for n in CROSSING_COUNTS.into_iter().filter(|n| *n <= most) {
        let boxes = Scene::new(PAPER_SCENE, n as usize, SEED).boxes().to_vec();
        let without_ms = median_us(&mut all_pairs_rig(gpu, &boxes)?, budget)? / 1e3;
        let with_ms = median_us(&mut grid_rig(gpu, &boxes, false)?, budget)? / 1e3;
        let paper_ms = paper("table_7", n, ["without", "with"]);
        with_and_without.push(row!(n, without_ms, with_ms, paper_ms));
    }
    let moving_n = if quick { 2_000 } else { 100_000 };
    for moving_percent in [0, 10, 25, 50, 75, 100] {
        let mut scene = Scene::new(PAPER_SCENE, moving_n, SEED);
        let mut boxes = scene.boxes().to_vec();
        let mut rig = grid_rig(gpu, &boxes, false)?;
        let movers = moving_n * moving_percent / 100;
        let (mut times, started) = (Vec::new(), Instant::now());
        while times.is_empty() || started.elapsed() < budget {
            scene.step();
            boxes[..movers].copy_from_slice(&scene.boxes()[..movers]);
            rig.memory.boxes.write(&boxes);
            times.push(median_us(&mut rig, Duration::ZERO)?);
        }
        moving.push(row!(n: moving_n, moving_percent, frame_ms: median(times) / 1e3));
    }
    let title = Part::heading(1, "The grid, stage by stage");
    let papers = "Papers' figures: Avril et al. 2012, on an NVIDIA Quadro FX 3600M.";
    let mut report = Report::new("grid", vec![title, Part::text(papers)]);
    report.machine(machine_with(Some(gpu.info())));
    let [up, down, memory] = bandwidth;
    report.value("bandwidth", row!(up_gbs: up, down_gbs: down, memory_gbs: memory));
    let crossing = crossing(&with_and_without);
    report.value("crossing", crossing);
    report.section(
        "parts",
        "Table 6: update of boxes (α), update of the grid (β), pairs (δ), the whole",
        "α on the CPU, β and δ by the GPU's clock with the transfers, the whole by the host's. \
         `paper_ms` are α, β, δ and the whole.",
        &parts,
    );
    let crossing = match crossing {
        Some(n) => format!("The grid is faster from {n} boxes on (paper: beyond 1,000)."),
        None => "The grid is not faster at any of these (paper: beyond 1,000).".to_owned(),
    };
    report.section(
        "with_and_without",
        "Table 7: without and with the grid, ms a frame",
        &format!("{crossing} `paper_ms` are without and with."),
        &with_and_without,
    );
    report.section("engines", "Figure 5: engines by number of boxes, ms a frame", "", &engines);
    report.section(
        "moving",
        "Figure 6: share of boxes that move",
        "The paper's time does not depend on it either.",
        &moving,
    );
    report.section(
        "stages",
        "Stages of a uniform scene against their memory traffic, µs",
        &format!("Link {up:.1} GB/s up, {down:.1} down; video memory {memory:.0} GB/s (copies by the device)."),
        &stages,
    );
    let under_way_title = "Frames under way, uniform scene, frames a second";
    report.section("under_way", under_way_title, "", &under_way);
    report.section("scenes", "Scenes: boxes in shared memory → mask in shared memory", "", &scenes);
    Ok(report)
}

fn number(row: &Fields, name: &str) -> f64 {
    row[name].as_f64().unwrap_or(f64::NAN)
}

fn timed_stages(row: &Fields) -> impl Iterator<Item = (&str, f64)> {
    let stages = row["stage_us"].as_array().into_iter().flatten();
    stages.filter_map(|stage| Some((stage[0].as_str()?, stage[1].as_f64()?)))
}

fn crossing(rows: &[Fields]) -> Option<u64> {
    let slower = rows.iter().rposition(|row| row["with_ms"].as_f64() >= row["without_ms"].as_f64());
    rows.get(slower.map_or(0, |slot| slot + 1)).and_then(|row| row["n"].as_u64())
}

fn parts_row(row: &Fields, budget: Duration) -> Fields {
    let ms = |labels: &[&str]| -> f64 {
        let of = timed_stages(row).filter(|(label, _)| labels.contains(label));
        of.map(|(_, us)| us / 1e3).sum()
    };
    let n = number(row, "n") as u32;
    // The world boxes of rigid bodies, as a client makes them before it submits.
    let at = |i: u32| Vec3::new(i as f32, 0.5 * i as f32, 0.25 * i as f32);
    let placements: Vec<Placement> =
        (0..n).map(|i| Placement::rigid(at(i), Quat::from_rotation_y(i as f32))).collect();
    let locals = vec![Aabb::new(Vec3::splat(-0.5), Vec3::splat(0.5)); n as usize];
    let mut out = vec![Aabb::EMPTY; n as usize];
    let update_boxes_ms =
        median_ms(budget, || par_write_boxes(&Transformed::new(&locals, &placements), &mut out));
    row!(
        n,
        update_boxes_ms,
        update_grid_ms: ms(&["grid_cells", "grid_scan", "grid_scatter", "grid_slot"]),
        cull_ms: ms(&["grid_pairs", "grid_write"]),
        total_ms: update_boxes_ms + number(row, "frame_us") / 1e3,
        paper_ms: paper("table_6", n, ["alpha", "beta", "delta", "total"]),
    )
}

fn engines_row(row: &Fields, budget: Duration) -> Fields {
    let n = number(row, "n") as u32;
    let boxes = Scene::new(PAPER_SCENE, n as usize, SEED).boxes().to_vec();
    let mut reply = HeapReply::new();
    let mut time = |engine: EngineName| {
        let mut engine = cpu_engine(engine, Isa::best()).ok()?;
        Some(median_ms(budget, || {
            // A heap reply is refused only without memory; then the time means nothing.
            let _ = engine
                .cull(&CullInput::boxes(&boxes).threads(rayon::current_num_threads()), &mut reply);
        }))
    };
    row!(
        n,
        gpu_grid_ms: number(row, "frame_us") / 1e3,
        cpu_grid_ms: time(EngineName::CpuGrid),
        cpu_sap_ms: (n <= SWEEP_MOST).then(|| time(EngineName::CpuSap)).flatten(),
        paper_ms: figure(&format!("table_6[n={n}].total")),
    )
}

/// Bytes of a copy that is timed: several times a second-level cache.
const COPY_BYTES: u64 = 256 << 20;
const SOFTWARE_COPY_BYTES: u64 = 16 << 20;
const COPIES: usize = 5;

/// Of copies by the device: up, down, and within its memory, GB/s.
fn bandwidth(gpu: &Arc<Gpu>) -> Result<[f64; 3], GpuError> {
    let bytes = if gpu.is_software() { SOFTWARE_COPY_BYTES } else { COPY_BYTES };
    let bench = Bench::new(gpu, Checks::Off)?;
    let block = |home| bench.block(home, bytes);
    let (host, video, other) = (block(Home::Host)?, block(Home::Video)?, block(Home::Video)?);
    let copy = |from: &Arc<Block>, to: &Arc<Block>| -> Result<f64, GpuError> {
        let part = |block| BlockPart::of(block, 0, bytes);
        let mut frame = bench.frame(vec![Command::Copy { from: part(from), to: part(to) }])?;
        let mut least_ns = f64::INFINITY;
        for _ in 0..COPIES {
            least_ns = least_ns.min(Bench::run(&mut frame)?.iter().map(|step| step.ns).sum());
        }
        Ok(bytes as f64 / least_ns)
    };
    Ok([copy(&host, &video)?, copy(&video, &host)?, 2.0 * copy(&video, &other)?])
}

fn stages_of(row: &Fields, bandwidth: [f64; 3]) -> Vec<Fields> {
    let [n, cells, words] = ["n", "cells", "words"].map(|name| number(row, name) as u64);
    let stage = |(stage, us): (&str, f64)| {
        // Up, down and video memory. Each box and each word counts once, each cell 4 bytes;
        // repeated reads (neighbours, crowded cells) are assumed to hit a cache.
        let (up, down, memory) = match stage {
            "grid_cells" => (24 * n, 0, 32 * n + 8 * n),
            "grid_scan" => (0, 0, 8 * cells),
            "grid_scatter" => (0, 0, 24 * n),
            "grid_slot" => (0, 0, 76 * n),
            "grid_pairs" => (0, 4 * n, 32 * n + 4 * cells + 12 * words),
            "grid_write" => (0, 12 * words, 12 * words + 4 * cells),
            _ => (0, 0, 0),
        };
        let ns =
            [up, down, memory].into_iter().zip(bandwidth).map(|(bytes, gbs)| bytes as f64 / gbs);
        row!(
            n,
            stage,
            us,
            link_bytes: up + down,
            memory_bytes: memory,
            floor_us: ns.fold(0.0, f64::max) / 1e3,
        )
    };
    timed_stages(row).map(stage).collect()
}

const LEAST_FRAMES: usize = 3;
const ROUNDS: usize = 16;
/// Mask words a box that the reply has room for.
const WORDS_A_BOX: u64 = 20;

/// Measures a scene in motion, then its stages. The first and the last mask are compared with the CPU's.
fn measure_scene(gpu: &Arc<Gpu>, name: SceneName, n: u32, budget: Duration) -> Result<Fields> {
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
        cells: grid_layout(BoxSlice::from(scene.boxes())).cell_end,
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

fn grid_rig(gpu: &Arc<Gpu>, boxes: &[Aabb], profiled: bool) -> Result<Rig<Grid>> {
    let imports = SharedImports::default();
    let options = EngineOptions { profiled, imports: imports.clone(), ..EngineOptions::default() };
    let memory = FrameSegments::new(gpu, &imports, boxes, reply_words(boxes.len()))?;
    Ok(Rig { engine: Grid::new(gpu, &options)?, memory })
}

fn all_pairs_rig(gpu: &Arc<Gpu>, boxes: &[Aabb]) -> Result<Rig<AllPairs>> {
    let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
    let capacity = first_capacity(Found::Words, n).max(WORDS_A_BOX * u64::from(n.get()));
    let words = MaskShape::exact(Encoding::Sparse, n, capacity, false).extent_words();
    let imports = SharedImports::default();
    let options = EngineOptions { imports: imports.clone(), ..EngineOptions::default() };
    let memory = FrameSegments::new(gpu, &imports, boxes, words)?;
    Ok(Rig { engine: AllPairs::new(gpu, options)?, memory })
}

/// Median of frames of unmoved boxes on a warm device, by the host's clock, µs.
fn median_us(rig: &mut Rig<impl Engine>, budget: Duration) -> Result<f64> {
    let times = repeated(budget, ROUNDS, || {
        let start = Instant::now();
        rig.frame().map(|_| start.elapsed().as_secs_f64() * 1e6)
    });
    let mut times = times.into_iter().collect::<Result<Vec<_>, _>>()?;
    // The first half warms up.
    Ok(median(times.split_off(times.len() / 2)))
}

fn frames_a_second(
    gpu: &Arc<Gpu>,
    boxes: &[Aabb],
    under_way: usize,
    budget: Duration,
) -> Result<f64> {
    let imports = SharedImports::default();
    let options = EngineOptions { imports: imports.clone(), ..EngineOptions::default() };
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
    let entries = WORDS_A_BOX * u64::from(n.get());
    Sizes::of(n).reply_words(Capacity { found: Found::Words, entries })
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
        Ok(rig.engine.step_times().to_vec())
    });
    let samples = samples.into_iter().collect::<Result<Vec<_>, CullError>>()?;
    // The first half of the frames of the same boxes warms up.
    let warm = || samples.chunks(ROUNDS).flat_map(|round| round.iter().skip(ROUNDS / 2));
    let labels = samples[0].iter().map(|step| step.label);
    let us = |at: usize| warm().filter_map(|steps| Some(steps.get(at)?.ns / 1e3)).collect();
    Ok(labels.enumerate().map(|(at, label)| (label.to_owned(), median(us(at)))).collect())
}

/// Compares the pairs with those of the CPU's grid: counts, and a hash that depends on no order.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crossing_is_behind_the_last_row_that_all_pairs_win() {
        let row = |n: u32, without_ms: f64, with_ms: f64| row!(n, without_ms, with_ms);
        let rows = [row(1, 1.0, 2.0), row(2, 2.0, 1.0), row(3, 1.0, 2.0), row(4, 2.0, 1.0)];
        assert_eq!(crossing(&rows), Some(4));
        assert_eq!(crossing(&rows[..3]), None);
        assert_eq!(crossing(&rows[1..2]), Some(2));
    }

    #[test]
    fn a_quick_study_fills_every_table_and_compares_every_mask() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let report = measure(&GpuChoice::Software, &[700], true)?;
        report.write(&folder.path().join("records"))?;
        let list = |name: &str| &report.lists[name];
        assert_eq!(list("scenes").len(), 4);
        let is_measured =
            |row: &Fields| number(row, "pairs") > 0.0 && number(row, "frame_us") > 0.0;
        assert!(list("scenes").iter().all(|row| row["checked"] == true && is_measured(row)));
        assert!(list("stages").iter().all(|row| row["floor_us"].as_f64() > Some(0.0)));
        let counts =
            ["stages", "parts", "engines", "under_way", "moving"].map(|name| list(name).len());
        assert_eq!(counts, [6, 1, 1, 1, 6]);
        assert!(list("with_and_without").iter().any(|row| row["paper_ms"].is_array()));
        let text = std::fs::read_to_string(folder.path().join("records/grid.md"))?;
        for heading in ["Table 6", "Table 7", "Figure 5", "Figure 6", "Stages", "Frames under way"]
        {
            assert!(text.contains(heading), "{heading}");
        }
        Ok(())
    }
}
