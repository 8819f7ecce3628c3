//! `plan`: the planned engine beside the best one, scene by scene.

use std::num::NonZeroUsize;
use std::time::Duration;

use crate::study::ways::{Case, Effort, Pools, WaySet, core_count, measure, thread_counts};
use clap::Args;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::Calibration;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::options::Place;
use pairmaskd::cli::output::progress_bar;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::scene::SceneName;
use serde::Serialize;

use super::error::LabError;
use super::scenes::SceneSizes;
use crate::study::harness::document::Part;
use crate::study::harness::table::Table;
use crate::study::harness::{Print, Report, deliver};
use crate::study::judge::{Judgement, judge};

/// Default sizes: dense where the fastest engine changes.
const SIZES: [u32; 12] =
    [64, 128, 256, 500, 1_000, 2_000, 4_096, 10_000, 32_768, 100_000, 300_000, 1_000_000];
/// A plan whose time over the best way's is above this is listed as bad.
const LIMIT: f64 = 1.3;
const EFFORT: Effort =
    Effort { least_frames: 5, most_frames: 200, time: Duration::from_millis(200) };

/// The planned engine beside the best one
#[derive(Debug, Args)]
#[command(after_help = "\
All CPU engines cull the same moving boxes, interleaved, in process. The ratio is the time of the
planned engine and of planning, over that of the fastest engine, encoding and number of threads.
Frames count from boxes in place to the last pair decoded; the shortest one counts. Rows above 1.3
are counted. Without arguments it takes minutes.

Examples:
  pairmask-lab plan --scene uniform,rods --n 64,1000,4096
  pairmask-lab plan --json")]
pub struct PlanBench {
    #[command(flatten)]
    what: SceneSizes,
    /// Threads that the plan may use, each by itself [default: 1 and all cores]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N,..", value_delimiter = ',')]
    threads: Vec<NonZeroUsize>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The JSON object of `plan --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
struct PlanReport {
    machine: Machine,
    /// Origin of the constants.
    calibration: String,
    rows: Vec<PlanRow>,
}

#[derive(Debug, Serialize)]
struct PlanRow {
    scene: &'static str,
    n: usize,
    threads: usize,
    /// Null where the plan chose a way that was not measured because its prediction was hopeless: a
    /// miss.
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

impl PlanRow {
    fn new(case: Case, threads: usize, plan_ns: u64, found: Option<&Judgement>) -> Self {
        Self {
            scene: case.scene.as_str(),
            n: case.n,
            threads,
            ratio: found.map(Judgement::ratio),
            engine: found.map(|j| j.planned.engine.as_str()),
            encoding: found.map(|j| j.planned.encoding.as_str()),
            engine_threads: found.map(|j| j.planned.threads),
            planned_ns: found.map(|j| j.planned_ns),
            predicted_ns: found.map(|j| j.predicted_ns as u64),
            plan_ns,
            best_engine: found.map(|j| j.best.engine.as_str()),
            best_encoding: found.map(|j| j.best.encoding.as_str()),
            best_threads: found.map(|j| j.best.threads),
            best_ns: found.map(|j| j.best_ns),
        }
    }

    fn is_miss(&self) -> bool {
        self.ratio.is_none_or(|ratio| ratio > LIMIT)
    }
}

impl PlanBench {
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), LabError> {
        let (machine, isa) = (Machine::this(), place.isa(config));
        let calibration = Calibration::built_in(isa.get());
        let mut allowed: Vec<usize> = self.threads.iter().map(|n| n.get()).collect();
        if allowed.is_empty() {
            allowed = vec![1, core_count()];
            allowed.dedup();
        }
        let not_quadratic = SceneName::ALL.into_iter().filter(|scene| !scene.is_quadratic());
        let cases = self.what.cases(&not_quadratic.collect::<Vec<_>>(), &SIZES);
        let rows = rows(&cases, &allowed, &calibration, isa)?;
        let calibration = format!("built in for {}", isa.get());
        let report = PlanReport { machine, calibration, rows };
        let print = if self.json { Print::Json } else { Print::Text };
        Ok(deliver(&report, None, print)?)
    }
}

fn rows(
    cases: &[Case],
    allowed: &[usize],
    calibration: &Calibration,
    isa: AvailableIsa,
) -> Result<Vec<PlanRow>, LabError> {
    let most = allowed.iter().max().copied().unwrap_or(1);
    let mut lanes = thread_counts(most);
    lanes.extend(allowed);
    lanes.sort_unstable();
    lanes.dedup();
    let pools = Pools::new(&lanes)?;
    let progress = progress_bar(cases.len() as u64, "measuring");
    let mut rows = Vec::new();
    for case in cases {
        let measured = measure(*case, WaySet::All, &lanes, &pools, &EFFORT, isa)?;
        for threads in allowed {
            let found = judge(&measured, *threads, calibration);
            rows.push(PlanRow::new(*case, *threads, measured.plan_ns, found.as_ref()));
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    Ok(rows)
}

impl Report for PlanReport {
    const NAME: &'static str = "plan";

    fn parts(&self) -> Vec<Part> {
        let Machine { cpu, cores, .. } = &self.machine;
        let misses = self.rows.iter().filter(|row| row.is_miss()).count();
        let worst = self.rows.iter().filter_map(|row| row.ratio).fold(0.0, f64::max);
        let rows = self.rows.len();
        vec![
            Part::text(format!("{cpu}, {cores} cores; constants: {}", self.calibration)),
            Part::Table(Table::of(&self.rows)),
            Part::text(format!("{misses} of {rows} above {LIMIT}; worst {worst:.2}")),
        ]
    }
}
