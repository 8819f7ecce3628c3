//! Judges the plan's choice: the planned way beside the fastest measured one.

use std::time::Duration;

use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Capabilities, plan};
use pairmaskd::cli::machine::Machine;
use serde::Serialize;

use super::harness::Report;
use super::harness::document::Part;
use super::harness::table::Table;
use super::ways::{
    Case, CaseTimes, Effort, Pools, Way, WaySet, core_count, measure_case, thread_counts,
};
use crate::Result;

/// Default sizes: dense where the fastest engine changes.
pub const SIZES: [u32; 12] =
    [64, 128, 256, 500, 1_000, 2_000, 4_096, 10_000, 32_768, 100_000, 300_000, 1_000_000];
/// A plan whose time over the best way's is above this is listed as bad.
const LIMIT: f64 = 1.3;
const EFFORT: Effort =
    Effort { least_frames: 5, most_frames: 200, time: Duration::from_millis(200) };

/// The JSON object of `plan --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
pub struct PlanReport {
    machine: Machine,
    calibration: String,
    rows: Vec<PlanRow>,
}

#[derive(Debug, Default, Serialize)]
struct PlanRow {
    scene: &'static str,
    n: usize,
    threads: usize,
    /// Null, as all that is about the planned way, where the plan chose one that was not measured because its
    /// prediction was hopeless: a miss.
    ratio: Option<f64>,
    engine: Option<&'static str>,
    encoding: Option<&'static str>,
    engine_threads: Option<usize>,
    planned_ns: Option<u64>,
    predicted_ns: Option<u64>,
    plan_ns: u64,
    best_engine: Option<&'static str>,
    best_encoding: Option<&'static str>,
    best_threads: Option<usize>,
    best_ns: Option<u64>,
}

/// Judges the plan of a measured case with a number of threads.
fn judge(measured: &CaseTimes, threads: usize, calibration: &Calibration) -> PlanRow {
    let Case { scene, n } = measured.case;
    let plan_ns = measured.plan_ns;
    let miss = PlanRow { scene: scene.as_str(), n, threads, plan_ns, ..PlanRow::default() };
    let capabilities = Capabilities { threads, gpu: None };
    let plan = plan(&measured.stats, &capabilities, calibration, &CullOptions::default());
    let planned = Way { engine: plan.engine, encoding: plan.encoding, threads: plan.threads };
    let allowed = measured.ways.iter().filter(|(way, _)| way.threads <= threads);
    let best = allowed.min_by_key(|(_, times)| times.least_ns());
    let found = measured.ways.iter().find(|(way, _)| *way == planned);
    let candidate = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine);
    let (Some((best, best_times)), Some((_, times)), Some(candidate)) = (best, found, candidate)
    else {
        return miss;
    };
    let (planned_ns, best_ns) = (times.least_ns(), best_times.least_ns());
    PlanRow {
        ratio: Some((planned_ns + plan_ns) as f64 / best_ns.max(1) as f64),
        engine: Some(planned.engine.as_str()),
        encoding: Some(planned.encoding.as_str()),
        engine_threads: Some(planned.threads),
        planned_ns: Some(planned_ns),
        predicted_ns: Some(candidate.predicted_ns as u64),
        best_engine: Some(best.engine.as_str()),
        best_encoding: Some(best.encoding.as_str()),
        best_threads: Some(best.threads),
        best_ns: Some(best_ns),
        ..miss
    }
}

/// Measures the cases; `threads`, which the plan may use, empty means 1 and all cores. `watch` is called after each
/// case.
pub fn measure(
    cases: &[Case],
    threads: &[usize],
    isa: AvailableIsa,
    watch: impl Fn(),
) -> Result<PlanReport> {
    let (machine, calibration) = (Machine::this(), Calibration::built_in(isa.get()));
    let mut allowed = threads.to_vec();
    if allowed.is_empty() {
        allowed = vec![1, core_count()];
        allowed.dedup();
    }
    let mut lanes = thread_counts(allowed.iter().max().copied().unwrap_or(1));
    lanes.extend(&allowed);
    lanes.sort_unstable();
    lanes.dedup();
    let pools = Pools::new(&lanes)?;
    let mut rows = Vec::new();
    for case in cases {
        let measured = measure_case(*case, WaySet::All, &lanes, &pools, &EFFORT, isa)?;
        rows.extend(allowed.iter().map(|threads| judge(&measured, *threads, &calibration)));
        watch();
    }
    let calibration = format!("built in for {}", isa.get());
    Ok(PlanReport { machine, calibration, rows })
}

impl Report for PlanReport {
    const NAME: &'static str = "plan";

    fn parts(&self) -> Vec<Part> {
        let Machine { cpu, cores, .. } = &self.machine;
        let is_miss = |row: &&PlanRow| row.ratio.is_none_or(|ratio| ratio > LIMIT);
        let misses = self.rows.iter().filter(is_miss).count();
        let worst = self.rows.iter().filter_map(|row| row.ratio).fold(0.0, f64::max);
        let rows = self.rows.len();
        vec![
            Part::text(format!("{cpu}, {cores} cores; constants: {}", self.calibration)),
            Part::Table(Table::of(&self.rows)),
            Part::text(format!("{misses} of {rows} above {LIMIT}; worst {worst:.2}")),
        ]
    }
}
