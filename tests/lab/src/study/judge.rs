//! Judges the plan's choice: what is planned, after some frames to learn from, beside the fastest measured way.

use pairmask_core::Encoding;
use pairmask_core::engine::AvailableIsa;
use pairmaskd::cli::machine::Machine;

use super::harness::{Fields, Part, Report, Table, percentile, row};
use super::ways::{
    Case, CaseTimes, Planned, core_count, distinct, measure_case, pools, thread_counts,
};
use crate::Result;

/// Default sizes: dense where the fastest engine changes.
pub const SIZES: [u32; 12] =
    [64, 128, 256, 500, 1_000, 2_000, 4_096, 10_000, 32_768, 100_000, 300_000, 1_000_000];
/// Plans whose time over the best way's is above these are counted.
const LIMITS: [f64; 2] = [1.15, 1.4];
/// Largest scene whose dense mask, of 1 MiB, is measured: no plan chooses it for one pair a box.
const DENSE_BOXES: usize = 4_096;

/// Half of the frames of a measurement.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Half {
    /// By which the best way is chosen.
    Chosen,
    /// By which that and the planned one are measured.
    Measured,
}

impl Half {
    /// That of a frame. In no period, since the ways take turns in one.
    const fn of(frame: usize) -> Self {
        if frame.count_ones().is_multiple_of(2) { Self::Chosen } else { Self::Measured }
    }
}

/// The lower quartile of half the frames: what else runs on the machine lengthens frames, and never shortens one.
fn quartile_of_half(times: &[u64], half: Half) -> u64 {
    let times = times.iter().enumerate().filter(|(frame, _)| Half::of(*frame) == half);
    percentile(times.map(|(_, ns)| *ns as f64).collect(), 25) as u64
}

/// Judges what was planned for a measured case.
fn judge(measured: &CaseTimes, planned: &Planned) -> Option<Fields> {
    let Case { scene, n } = measured.case;
    let Planned { threads, plan, .. } = planned;
    let allowed = measured.ways.iter().filter(|timed| timed.way.threads <= *threads);
    let best = allowed.min_by_key(|timed| quartile_of_half(&timed.total_ns(), Half::Chosen))?;
    let best_ns = quartile_of_half(&best.total_ns(), Half::Measured);
    let planned_ns = quartile_of_half(&planned.total_ns, Half::Measured);
    let candidate = plan.candidates[plan.engine.ordinal()];
    Some(row!(
        scene: scene.as_str(),
        n,
        threads,
        ratio: planned_ns as f64 / best_ns.max(1) as f64,
        engine: plan.engine.as_str(),
        encoding: plan.encoding.as_str(),
        engine_threads: plan.threads,
        planned_ns,
        predicted_ns: candidate.map(|candidate| candidate.predicted_ns as u64),
        best_engine: best.way.engine.as_str(),
        best_encoding: best.way.encoding.as_str(),
        best_threads: best.way.threads,
        best_ns,
    ))
}

/// `threads`, which the plan may use, empty means 1 and all cores. `watch` is called after each case.
pub fn measure(
    cases: &[Case],
    threads: &[usize],
    isa: AvailableIsa,
    watch: impl Fn(),
) -> Result<Report> {
    let machine = Machine::this();
    let allowed: &[usize] =
        if threads.is_empty() { &distinct(vec![1, core_count()]) } else { threads };
    let lanes = thread_counts(allowed.iter().max().copied().unwrap_or(1));
    let lanes = distinct([&lanes[..], allowed].concat());
    let pools = pools(&lanes)?;
    let mut rows = Vec::new();
    for case in cases {
        let fits = |encoding: &Encoding| *encoding != Encoding::Dense || case.n <= DENSE_BOXES;
        let encodings: Vec<Encoding> = Encoding::ALL.into_iter().filter(fits).collect();
        let measured = measure_case(*case, &encodings, &lanes, allowed, &pools, isa)?;
        rows.extend(measured.planned.iter().filter_map(|planned| judge(&measured, planned)));
        watch();
    }
    let calibration = format!("built in for {}", isa.get());
    let ratios = || rows.iter().filter_map(|row| row["ratio"].as_f64());
    let above = |limit: f64| ratios().filter(|ratio| *ratio > limit).count();
    let [near, far] = LIMITS.map(above);
    let (worst, count) = (ratios().fold(0.0, f64::max), rows.len());
    let Machine { cpu, cores, .. } = &machine;
    let parts = vec![
        Part::text(format!("{cpu}, {cores} cores; constants: {calibration}")),
        Part::Table(Table::of(&rows)),
        Part::text(format!(
            "{near} of {count} above {}, {far} above {}; worst {worst:.2}",
            LIMITS[0], LIMITS[1]
        )),
    ];
    let mut report = Report::new("plan", parts);
    report.value("machine", &machine);
    report.value("calibration", &calibration);
    report.list("rows", &rows);
    Ok(report)
}
