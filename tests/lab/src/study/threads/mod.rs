//! Speed-up by threads of the papers' two stages: boxes from transforms, and pairs from boxes.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Collision detection: broad phase adaptation from
//! multi-core to multi-GPU architecture", 2014, §4, and their paper of 2009.

pub mod paper;
mod report;

use std::time::Duration;

use crate::study::ways::{
    Case, CaseTimes, Effort, MeasureError, Pools, WaySet, core_count, measure as measure_ways,
    thread_counts,
};
use pairmask_core::EngineName;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::update::UpdateError;
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::output::OutputError;
use pairmaskd::file_error::FileError;
use pairmaskd::scene::SceneName;

pub use self::report::{Stage, ThreadsReport, ThreadsRow};
use super::updates::update_times;

/// Default sizes beside the paper's own.
pub const SIZES: [u32; 2] = [10_000, 100_000];
/// Scenes of those sizes.
pub const SCENES: [SceneName; 3] = [SceneName::Uniform, SceneName::Torus, SceneName::Letters];
/// Calls of the watcher for each case: one a stage.
pub const STEPS_A_CASE: u64 = 2;
const EFFORT: Effort =
    Effort { least_frames: 7, most_frames: 200, time: Duration::from_millis(400) };

/// Why the study failed.
#[derive(Debug, thiserror::Error)]
pub enum ThreadsError {
    /// Threads or an engine failed.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// Boxes and transforms differ in number.
    #[error(transparent)]
    Update(#[from] UpdateError),
    /// The report has no JSON form.
    #[error(transparent)]
    Json(#[from] OutputError),
    /// The files could not be written.
    #[error(transparent)]
    Write(#[from] FileError),
}

/// The scenes of the 2014 paper in its own sizes.
pub fn papers_cases() -> impl Iterator<Item = Case> {
    paper::SCENES.iter().map(|paper| Case { scene: paper.scene, n: paper.n })
}

/// Measures both stages of every case; `threads` empty means 1, 2, 4 … all cores. `watch` is called
/// [`STEPS_A_CASE`] times for each case.
///
/// # Errors
/// [`ThreadsError`].
pub fn measure(
    cases: &[Case],
    threads: &[usize],
    watch: impl Fn(),
) -> Result<ThreadsReport, ThreadsError> {
    let machine = Machine::this();
    let mut threads = threads.to_vec();
    if threads.is_empty() {
        threads = thread_counts(core_count());
    }
    // Speed-ups are over one thread.
    threads.push(1);
    threads.sort_unstable();
    threads.dedup();
    let pools = Pools::new(&threads)?;
    let (mut rows, isa) = (Vec::new(), AvailableIsa::best());
    for case in cases {
        let updates = update_times(case.scene, case.n, &threads, &pools, &EFFORT)?;
        rows.extend(ThreadsRow::series(Stage::UpdateAabbs, *case, None, updates));
        watch();
        let measured = measure_ways(*case, WaySet::Sparse, &threads, &pools, &EFFORT, isa)?;
        rows.extend(pair_rows(&measured));
        watch();
    }
    Ok(ThreadsReport { machine, rows })
}

/// Rows of the second stage: one for every engine and number of threads.
fn pair_rows(measured: &CaseTimes) -> Vec<ThreadsRow> {
    let mut rows = Vec::new();
    for engine in EngineName::ALL {
        let ways = measured.ways.iter().filter(|(way, _)| way.engine == engine);
        let series: Vec<_> =
            ways.map(|(way, times)| (way.threads, times.engine_ns.clone())).collect();
        rows.extend(ThreadsRow::series(
            Stage::OverlappingPairs,
            measured.case,
            Some(engine),
            series,
        ));
    }
    rows
}
