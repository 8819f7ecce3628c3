//! The sweep beside the grid and all pairs, scene by scene, by the GPU's clock.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::engine::{CullError, CullReport, Engine};
use pairmask_core::engine::{CullInput, Grid as CpuGrid, HeapReply};
use pairmask_core::{Aabb, BoxCount, Encoding};
use pairmaskd::execute::gpu::{Checks, Gpu};

use super::device::{GpuSweep, SweepError};
use super::scenes::SweepScene;
use super::{Other, Part, SweepReport, SweepRow, SweepTimes};
use crate::gpu_stages::BenchError;
use crate::gpu_stages::grid::{all_pairs_time, grid_time};
use crate::study::harness::machine::Machine;
use crate::study::harness::{StudyError, median, repeated};

/// Runs of a scene, at least; the first half warms up.
const RUNS: usize = 16;
/// Boxes up to which all pairs take part; beyond, they take a third of a second a frame, and do where the grid refuses.
const ALL_PAIRS_MOST: u32 = 200_000;

/// Measures all scenes.
pub(super) fn measure(
    gpu: &Arc<Gpu>,
    counts: &[u32],
    budget: Duration,
) -> Result<SweepReport, StudyError> {
    let mut sweep = GpuSweep::new(gpu, Checks::Off)?;
    let mut rows = Vec::new();
    for &n in counts {
        for scene in SweepScene::ALL {
            rows.push(row(&mut sweep, scene, n, budget)?);
        }
    }
    Ok(SweepReport { machine: Machine::here(Some(gpu.info())), rows })
}

fn row(
    sweep: &mut GpuSweep,
    scene: SweepScene,
    n: u32,
    budget: Duration,
) -> Result<SweepRow, StudyError> {
    let boxes = scene.boxes(n);
    let truth = truth(&boxes)?;
    let wrong = |engine| StudyError::Wrong { engine, scene: scene.to_string(), n };
    let ours = match sweep.recorded(&boxes) {
        Ok((mut recorded, swept)) => {
            let mut pairs = swept.pairs;
            pairs.sort_unstable();
            if pairs != truth {
                return Err(wrong("the sweep"));
            }
            let runs = repeated(budget, RUNS, || {
                let mut parts = [0.0; Part::ALL.len()];
                for step in sweep.run(&mut recorded)? {
                    parts[Part::of(step.label) as usize] += step.ns / 1e3;
                }
                Ok::<_, StudyError>(parts)
            })?;
            let warm = &runs[runs.len() / 2..];
            let part = |part: usize| median(warm.iter().map(|run| run[part]).collect());
            let passes = recorded.passes();
            Some(SweepTimes {
                entries: swept.entries,
                tubes: 1 << (swept.plan.bits[1] + swept.plan.bits[2]),
                passes,
                tested: swept.tested,
                parts_us: std::array::from_fn(part),
                all_us: median(warm.iter().map(|run| run.iter().sum()).collect()),
            })
        }
        Err(SweepError::TooCrowded) => None,
        Err(SweepError::Gpu(error)) => return Err(error.into()),
    };
    let gpu = sweep.gpu();
    let other = |answer: Result<(CullReport, f64), BenchError>, engine| match answer {
        Ok((report, all_us)) if report.pair_count == truth.len() as u64 => {
            let tested = BoxCount::new(n).pair_count() - report.skipped.pairs;
            Ok(Some(Other { tested, all_us }))
        }
        Ok(_) => Err(wrong(engine)),
        Err(BenchError::Cull(CullError::TooCrowded { .. })) => Ok(None),
        Err(error) => Err(error.into()),
    };
    let grid = other(grid_time(gpu, &boxes, budget), "gpu-grid")?;
    let all_pairs = if n <= ALL_PAIRS_MOST || grid.is_none() {
        other(all_pairs_time(gpu, &boxes, budget), "gpu-brute")?
    } else {
        None
    };
    Ok(SweepRow {
        scene: scene.to_string(),
        n,
        pairs: truth.len() as u64,
        sweep: ours,
        grid,
        all_pairs,
    })
}

/// The pairs by the cores' grid, in order.
fn truth(boxes: &[Aabb]) -> Result<Vec<[u32; 2]>, StudyError> {
    let threads = rayon::current_num_threads();
    let input = CullInput::boxes(boxes).encoding(Encoding::List).threads(threads);
    let mut reply = HeapReply::new();
    let report = CpuGrid::new().cull(&input, &mut reply).map_err(BenchError::from)?;
    let words = &reply.words()[..2 * report.pair_count as usize];
    let mut pairs: Vec<[u32; 2]> =
        words.as_chunks().0.iter().map(|[a, b]| [*a.min(b), *a.max(b)]).collect();
    pairs.sort_unstable();
    Ok(pairs)
}
