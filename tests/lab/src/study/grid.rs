//! The grid study: the cost of the grid, stage by stage, and the sizes from which on it pays.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §4 to §6: tables 6 and 7, figures 5 and 6, measured
//! there on an NVIDIA Quadro FX 3600M. Boxes lie in shared memory, the mask comes back there; no
//! daemon is between.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{Quat, Vec3};
use pairmask_core::Aabb;
use pairmask_core::engine::{CullInput, EngineName, HeapReply, Isa, cpu_engine};
use pairmask_core::update::{Placement, Transformed};
use pairmask_core::write::par_write_boxes;
use pairmaskd::execute::gpu::{
    Block, Checks, Command, Gpu, GpuChoice, GpuError, Home, HostImport, Part as BlockPart,
};
use pairmaskd::scene::{Scene, SceneName};

use super::harness::document::Part;
use super::harness::machine::Machine;
use super::harness::table::{Fields, row};
use super::harness::{Report, median, median_ms};
use super::mapping::gpu::Bench;
use super::papers::figure;
use crate::Result;
use crate::gpu_stages::grid::{
    SCENES, all_pairs_rig, frames_a_second, grid_rig, measure as measure_scene, median_us,
};

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
    let [mut scenes, mut stages, mut parts, mut engines, mut under_way] =
        <[Vec<Fields>; 5]>::default();
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
        under_way.push(under_way_row(gpu, n, budget)?);
    }
    let most = if quick { 2_000 } else { u32::MAX };
    let with_and_without = CROSSING_COUNTS
        .into_iter()
        .filter(|n| *n <= most)
        .map(|n| without_row(gpu, n, budget))
        .collect::<Result<Vec<_>, _>>()?;
    let moving_n = if quick { 2_000 } else { 100_000 };
    let moving = [0, 10, 25, 50, 75, 100]
        .into_iter()
        .map(|percent| moving_row(gpu, moving_n, percent, budget))
        .collect::<Result<Vec<_>, _>>()?;
    let title = Part::heading(1, "The grid, stage by stage");
    let papers = "Papers' figures: Avril et al. 2012, on an NVIDIA Quadro FX 3600M.";
    let mut report = Report::new("grid", vec![title, Part::text(papers)]);
    report.machine(&Machine::here(Some(gpu.info())));
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
    rows.get(slower.map_or(0, |place| place + 1)).and_then(|row| row["n"].as_u64())
}

fn parts_row(row: &Fields, budget: Duration) -> Fields {
    let ms = |labels: &[&str]| -> f64 {
        let of = timed_stages(row).filter(|(label, _)| labels.contains(label));
        of.map(|(_, us)| us / 1e3).sum()
    };
    let n = number(row, "n") as u32;
    let update_boxes_ms = update_ms(n, budget);
    row!(
        n,
        update_boxes_ms,
        update_grid_ms: ms(&["grid_cells", "grid_scan", "grid_scatter", "grid_place"]),
        cull_ms: ms(&["grid_pairs", "grid_write"]),
        total_ms: update_boxes_ms + number(row, "frame_us") / 1e3,
        paper_ms: paper("table_6", n, ["alpha", "beta", "delta", "total"]),
    )
}

/// Time to make the world boxes of rigid bodies, as a client does before it submits.
fn update_ms(n: u32, budget: Duration) -> f64 {
    let at = |i: u32| Vec3::new(i as f32, 0.5 * i as f32, 0.25 * i as f32);
    let placements: Vec<Placement> =
        (0..n).map(|i| Placement::rigid(at(i), Quat::from_rotation_y(i as f32))).collect();
    let locals = vec![Aabb::new(Vec3::splat(-0.5), Vec3::splat(0.5)); n as usize];
    let mut out = vec![Aabb::EMPTY; n as usize];
    median_ms(budget, || par_write_boxes(&Transformed::new(&locals, &placements), &mut out))
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

fn without_row(gpu: &Arc<Gpu>, n: u32, budget: Duration) -> Result<Fields> {
    let boxes = Scene::new(PAPER_SCENE, n as usize, SEED).boxes().to_vec();
    let without_ms = median_us(&mut all_pairs_rig(gpu, &boxes)?, budget)? / 1e3;
    let with_ms = median_us(&mut grid_rig(gpu, &boxes, false)?, budget)? / 1e3;
    Ok(row!(n, without_ms, with_ms, paper_ms: paper("table_7", n, ["without", "with"])))
}

fn under_way_row(gpu: &Arc<Gpu>, n: u32, budget: Duration) -> Result<Fields> {
    let scene = Scene::new(SceneName::Uniform, n as usize, SEED);
    let fps = |under_way| frames_a_second(gpu, scene.boxes(), under_way, budget);
    Ok(row!(n, one_fps: fps(1)?, two_fps: fps(2)?))
}

fn moving_row(gpu: &Arc<Gpu>, n: u32, moving_percent: u32, budget: Duration) -> Result<Fields> {
    let mut scene = Scene::new(PAPER_SCENE, n as usize, SEED);
    let mut boxes = scene.boxes().to_vec();
    let mut rig = grid_rig(gpu, &boxes, false)?;
    let moving = (u64::from(n) * u64::from(moving_percent) / 100) as usize;
    let mut times = Vec::new();
    let started = Instant::now();
    while times.is_empty() || started.elapsed() < budget {
        scene.step();
        boxes[..moving].copy_from_slice(&scene.boxes()[..moving]);
        rig.memory.boxes.write(&boxes);
        times.push(median_us(&mut rig, Duration::ZERO)?);
    }
    Ok(row!(n, moving_percent, frame_ms: median(times) / 1e3))
}

/// Bytes of a copy that is timed: several times a second-level cache.
const COPY_BYTES: u64 = 256 << 20;
const SOFTWARE_COPY_BYTES: u64 = 16 << 20;
const COPIES: usize = 5;

/// Of copies by the device: up, down, and within its memory, GB/s.
fn bandwidth(gpu: &Arc<Gpu>) -> Result<[f64; 3], GpuError> {
    let bytes = if gpu.info().is_software() { SOFTWARE_COPY_BYTES } else { COPY_BYTES };
    let bench = Bench::new(gpu, Checks::Off)?;
    let block = |home| bench.block(home, bytes);
    let (host, video, other) = (block(Home::Host)?, block(Home::Video)?, block(Home::Video)?);
    let copy = |from: &Arc<Block>, to: &Arc<Block>| -> Result<f64, GpuError> {
        let part = |block| BlockPart::of(block, 0, bytes);
        let mut frame = bench.frame(vec![Command::Copy { from: part(from), to: part(to) }])?;
        let mut least_ns = f64::INFINITY;
        for _ in 0..COPIES {
            least_ns = least_ns.min(bench.run(&mut frame)?.iter().map(|step| step.ns).sum());
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
            "grid_place" => (0, 0, 76 * n),
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
