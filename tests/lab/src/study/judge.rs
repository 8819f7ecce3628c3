//! Judges the plan's choice: the planned way beside the fastest measured one.

use pairmask_core::Encoding;
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Capabilities, plan};
use pairmaskd::cli::machine::Machine;

use super::harness::{Fields, Part, Report, Table, row};
use super::ways::{
    Case, CaseTimes, TimedWay, Way, core_count, distinct, measure_case, pools, thread_counts,
};
use crate::Result;

/// Default sizes: dense where the fastest engine changes.
pub const SIZES: [u32; 12] =
    [64, 128, 256, 500, 1_000, 2_000, 4_096, 10_000, 32_768, 100_000, 300_000, 1_000_000];
/// A plan whose time over the best way's is above this is listed as bad.
const LIMIT: f64 = 1.3;
/// Largest scene whose dense mask, of 1 MiB, is measured: no plan chooses it for one pair a box.
const DENSE_BOXES: usize = 4_096;

/// Judges the plan of a measured case with a number of threads. All that is about the planned way is null where the plan
/// chose one that was not measured because its prediction was hopeless: a miss.
fn judge(measured: &CaseTimes, threads: usize, calibration: &Calibration) -> Fields {
    let (Case { scene, n }, plan_ns) = (measured.case, measured.plan_ns);
    let capabilities = Capabilities { threads, gpu: None };
    let plan = plan(&measured.stats, &capabilities, calibration, &CullOptions::default());
    let planned = Way { engine: plan.engine, encoding: plan.encoding, threads: plan.threads };
    let allowed = measured.ways.iter().filter(|timed| timed.way.threads <= threads);
    let best = allowed.map(|timed| (timed.way, timed.least_ns())).min_by_key(|(_, ns)| *ns);
    let of_planned = measured.ways.iter().find(|timed| timed.way == planned);
    let candidate = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine);
    let found = best.zip(of_planned.map(TimedWay::least_ns)).zip(candidate);
    let found = found.map(|((best, ns), candidate)| (best, ns, candidate.predicted_ns as u64));
    let best = found.map(|(best, ..)| best);
    let ratio =
        |((_, best_ns), ns, _): (_, u64, _)| (ns + plan_ns) as f64 / u64::max(best_ns, 1) as f64;
    row!(
        scene: scene.as_str(),
        n,
        threads,
        ratio: found.map(ratio),
        engine: found.map(|_| planned.engine.as_str()),
        encoding: found.map(|_| planned.encoding.as_str()),
        engine_threads: found.map(|_| planned.threads),
        planned_ns: found.map(|(_, ns, _)| ns),
        predicted_ns: found.map(|(.., ns)| ns),
        plan_ns,
        best_engine: best.map(|(way, _)| way.engine.as_str()),
        best_encoding: best.map(|(way, _)| way.encoding.as_str()),
        best_threads: best.map(|(way, _)| way.threads),
        best_ns: best.map(|(_, ns)| ns),
    )
}

/// `threads`, which the plan may use, empty means 1 and all cores. `watch` is called after each case.
pub fn measure(
    cases: &[Case],
    threads: &[usize],
    isa: AvailableIsa,
    watch: impl Fn(),
) -> Result<Report> {
    let (machine, calibration) = (Machine::this(), Calibration::built_in(isa.get()));
    let allowed: &[usize] =
        if threads.is_empty() { &distinct(vec![1, core_count()]) } else { threads };
    let lanes = thread_counts(allowed.iter().max().copied().unwrap_or(1));
    let lanes = distinct([&lanes[..], allowed].concat());
    let pools = pools(&lanes)?;
    let mut rows = Vec::new();
    for case in cases {
        let fits = |encoding: &Encoding| *encoding != Encoding::Dense || case.n <= DENSE_BOXES;
        let encodings: Vec<Encoding> = Encoding::ALL.into_iter().filter(fits).collect();
        let measured = measure_case(*case, &encodings, &lanes, &pools, isa)?;
        rows.extend(allowed.iter().map(|threads| judge(&measured, *threads, &calibration)));
        watch();
    }
    let calibration = format!("built in for {}", isa.get());
    let ratios = || rows.iter().map(|row| row["ratio"].as_f64());
    let misses = ratios().filter(|ratio| ratio.is_none_or(|ratio| ratio > LIMIT)).count();
    let (worst, count) = (ratios().flatten().fold(0.0, f64::max), rows.len());
    let Machine { cpu, cores, .. } = &machine;
    let parts = vec![
        Part::text(format!("{cpu}, {cores} cores; constants: {calibration}")),
        Part::Table(Table::of(&rows)),
        Part::text(format!("{misses} of {count} above {LIMIT}; worst {worst:.2}")),
    ];
    let mut report = Report::new("plan", parts);
    report.value("machine", &machine);
    report.value("calibration", &calibration);
    report.list("rows", &rows);
    Ok(report)
}
