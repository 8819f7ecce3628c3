//! The measurements, one function a table or figure.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{Quat, Vec3};
use pairmask_core::engine::{CullInput, Engine, Grid as CpuGrid, HeapReply, SweepAndPrune};
use pairmask_core::update::{Placement, par_update_boxes};
use pairmask_core::{Aabb, Encoding};
use pairmaskd::execute::gpu::Gpu;
use pairmaskd::scene::{Scene, SceneName};

use super::floor::{self, Bandwidth};
use super::{
    EnginesRow, GridError, GridOptions, GridReport, MovingRow, PartsRow, UnderWayRow, WithoutRow,
};
use crate::gpu_stages::grid::{
    FrameTimer, GridRow, SCENES, frames_a_second, measure as measure_scene,
};
use crate::study::machine::Machine;

/// The paper's scene: a column of objects of one size falls on a plane.
const PAPER_SCENE: SceneName = SceneName::Cubes;
/// Seed of all scenes.
const SEED: u64 = 1;

/// Avril et al. 2012, table 6: α, β, δ, total, ms.
pub const PAPER_PARTS: [(u32, [f64; 4]); 4] = [
    (1_000, [0.03, 0.13, 0.09, 0.25]),
    (10_000, [0.31, 1.45, 0.59, 2.35]),
    (100_000, [3.38, 11.12, 13.41, 27.91]),
    (1_000_000, [14.26, 134.91, 142.72, 291.89]),
];
/// Table 7: without and with the grid, ms.
pub const PAPER_WITHOUT: [(u32, [f64; 2]); 3] =
    [(100, [0.046, 1.020]), (1_000, [0.872, 1.840]), (10_000, [31.45, 3.257])];

/// Boxes of table 7, and between them to find the crossing.
const CROSSING_COUNTS: [u32; 10] =
    [100, 500, 1_000, 2_000, 4_000, 6_000, 8_000, 10_000, 16_000, 32_000];
/// Boxes beyond which the sweep takes seconds.
const SWEEP_MOST: u32 = 1_000_000;

/// What a frame of so many boxes took the authors in all, ms (table 6), whatever share of them moved.
pub fn paper_frame_ms(n: u32) -> Option<f64> {
    paper(&PAPER_PARTS, n).map(|[.., total]| total)
}

fn paper<T: Copy>(rows: &[(u32, T)], n: u32) -> Option<T> {
    rows.iter().find(|(known, _)| *known == n).map(|(_, figures)| *figures)
}

/// Measures everything.
pub(super) fn measure(gpu: &Arc<Gpu>, options: &GridOptions) -> Result<GridReport, GridError> {
    let budget = Duration::from_millis(if options.quick { 50 } else { 500 });
    let bandwidth = Bandwidth::measure(gpu)?;
    let mut scenes = Vec::new();
    let mut stages = Vec::new();
    let mut parts = Vec::new();
    let mut engines = Vec::new();
    let mut under_way = Vec::new();
    for &n in &options.counts {
        for name in SCENES {
            let row = measure_scene(gpu, name, n, Encoding::Sparse, budget, true)?;
            if name == SceneName::Uniform {
                stages.extend(floor::stages(&row, &bandwidth));
            }
            scenes.push(row);
        }
        let row = measure_scene(gpu, PAPER_SCENE, n, Encoding::Sparse, budget, true)?;
        parts.push(parts_row(&row, budget));
        engines.push(engines_row(&row, budget));
        under_way.push(under_way_row(gpu, n, budget)?);
    }
    let most = if options.quick { 2_000 } else { u32::MAX };
    let with_and_without = CROSSING_COUNTS
        .into_iter()
        .filter(|n| *n <= most)
        .map(|n| without_row(gpu, n, budget))
        .collect::<Result<Vec<_>, _>>()?;
    let moving_n = if options.quick { 2_000 } else { 100_000 };
    let moving = [0, 10, 25, 50, 75, 100]
        .into_iter()
        .map(|percent| moving_row(gpu, moving_n, percent, budget))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(GridReport {
        machine: Machine::here(Some(gpu.info())),
        bandwidth,
        scenes,
        stages,
        parts,
        crossing: crossing(&with_and_without),
        with_and_without,
        engines,
        moving,
        under_way,
    })
}

/// The fewest boxes from which on the grid is faster.
fn crossing(rows: &[WithoutRow]) -> Option<u32> {
    let slower = rows.iter().rposition(|row| row.with_ms >= row.without_ms);
    rows.get(slower.map_or(0, |place| place + 1)).map(|row| row.n)
}

fn parts_row(row: &GridRow, budget: Duration) -> PartsRow {
    let ms = |stages: &[&str]| -> f64 {
        let of = row.stage_us.iter().filter(|(label, _)| stages.contains(&label.as_str()));
        of.map(|(_, us)| us / 1e3).sum()
    };
    let update_boxes_ms = update_ms(row.n, budget);
    PartsRow {
        n: row.n,
        update_boxes_ms,
        update_grid_ms: ms(&["grid_cells", "grid_scan", "grid_scatter", "grid_place"]),
        cull_ms: ms(&["grid_pairs", "grid_write"]),
        total_ms: update_boxes_ms + row.frame_us / 1e3,
        paper_ms: paper(&PAPER_PARTS, row.n),
    }
}

/// Time to make the world boxes of rigid bodies, as a client does before it submits.
fn update_ms(n: u32, budget: Duration) -> f64 {
    let at = |i: u32| Vec3::new(i as f32, 0.5 * i as f32, 0.25 * i as f32);
    let placements: Vec<Placement> =
        (0..n).map(|i| Placement::rigid(at(i), Quat::from_rotation_y(i as f32))).collect();
    let locals = vec![Aabb::new(Vec3::splat(-0.5), Vec3::splat(0.5)); n as usize];
    let mut out = vec![Aabb::EMPTY; n as usize];
    median_ms(budget, || {
        // The slices have equal lengths, so that this cannot fail.
        let _ = par_update_boxes(&locals, &placements, &mut out);
    })
}

fn engines_row(row: &GridRow, budget: Duration) -> EnginesRow {
    let boxes = Scene::new(PAPER_SCENE, row.n as usize, SEED).boxes().to_vec();
    let mut reply = HeapReply::new();
    let mut time = |engine: &mut dyn Engine| {
        median_ms(budget, || {
            // A heap reply is refused only without memory; then the time means nothing.
            let _ = engine
                .cull(&CullInput::boxes(&boxes).threads(rayon::current_num_threads()), &mut reply);
        })
    };
    EnginesRow {
        n: row.n,
        gpu_grid_ms: row.frame_us / 1e3,
        cpu_grid_ms: time(&mut CpuGrid::new()),
        cpu_sap_ms: (row.n <= SWEEP_MOST).then(|| time(&mut SweepAndPrune::new())),
        paper_ms: paper(&PAPER_PARTS, row.n).map(|[_, _, _, total]| total),
    }
}

fn without_row(gpu: &Arc<Gpu>, n: u32, budget: Duration) -> Result<WithoutRow, GridError> {
    let boxes = Scene::new(PAPER_SCENE, n as usize, SEED).boxes().to_vec();
    let without_ms = FrameTimer::all_pairs(gpu, &boxes)?.median_us(budget)? / 1e3;
    let with_ms = FrameTimer::grid(gpu, &boxes)?.median_us(budget)? / 1e3;
    Ok(WithoutRow { n, without_ms, with_ms, paper_ms: paper(&PAPER_WITHOUT, n) })
}

fn under_way_row(gpu: &Arc<Gpu>, n: u32, budget: Duration) -> Result<UnderWayRow, GridError> {
    let scene = Scene::new(SceneName::Uniform, n as usize, SEED);
    let fps = |under_way| frames_a_second(gpu, scene.boxes(), under_way, budget);
    Ok(UnderWayRow { n, one_fps: fps(1)?, two_fps: fps(2)? })
}

fn moving_row(
    gpu: &Arc<Gpu>,
    n: u32,
    moving_percent: u32,
    budget: Duration,
) -> Result<MovingRow, GridError> {
    let mut scene = Scene::new(PAPER_SCENE, n as usize, SEED);
    let mut boxes = scene.boxes().to_vec();
    let mut timer = FrameTimer::grid(gpu, &boxes)?;
    let moving = (u64::from(n) * u64::from(moving_percent) / 100) as usize;
    let mut times = Vec::new();
    let started = Instant::now();
    while times.is_empty() || started.elapsed() < budget {
        scene.step();
        boxes[..moving].copy_from_slice(&scene.boxes()[..moving]);
        timer.write(&boxes);
        times.push(timer.median_us(Duration::ZERO)?);
    }
    Ok(MovingRow { n, moving_percent, frame_ms: median(times) / 1e3 })
}

fn median_ms(budget: Duration, mut run: impl FnMut()) -> f64 {
    let mut times = Vec::new();
    let started = Instant::now();
    while times.len() < 3 || started.elapsed() < budget {
        let start = Instant::now();
        run();
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    median(times)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crossing_is_behind_the_last_row_that_all_pairs_win() {
        let row = |n, without_ms, with_ms| WithoutRow { n, without_ms, with_ms, paper_ms: None };
        let rows = [row(1, 1.0, 2.0), row(2, 2.0, 1.0), row(3, 1.0, 2.0), row(4, 2.0, 1.0)];
        assert_eq!(crossing(&rows), Some(4));
        assert_eq!(crossing(&rows[..3]), None);
        assert_eq!(crossing(&rows[1..2]), Some(2));
    }
}
