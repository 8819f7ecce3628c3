//! `calibrate`: measures the constants of the plan's cost model on this machine.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use pairmask_core::engine::{AvailableIsa, EngineName};
use pairmask_core::plan::{Calibration, MachineKey, Term, ThreadCost, default_path, encode, store};
use serde::Serialize;

use super::machine::Machine;
use super::output::{OutputError, print_json, print_text, progress_bar};
use super::whole_number::whole_number;
use crate::calibrate::{
    Case, Effort, FitRow, MeasureError, Pools, WaySet, core_count, fit, measure, rows,
    thread_counts,
};
use crate::file_error::{Access, FileError};
use crate::scene::SceneName;

/// Scenes whose shapes the cost model tells apart.
const SCENES: [SceneName; 8] = [
    SceneName::Uniform,
    SceneName::Mixed,
    SceneName::Pile,
    SceneName::Plane,
    SceneName::Cubes,
    SceneName::Letters,
    SceneName::Rods,
    SceneName::Giants,
];
/// Sizes, dense where the fastest engine changes.
const SIZES: [usize; 12] =
    [64, 128, 180, 256, 512, 1_000, 1_500, 2_000, 3_000, 4_096, 8_192, 16_384];
/// Larger sizes, of two scenes: scenes that no cache holds.
const LARGE_SIZES: [usize; 3] = [65_536, 131_072, 524_288];
const LARGE_SCENES: [SceneName; 2] = [SceneName::Uniform, SceneName::Pile];
/// The scenes of `--quick`.
const QUICK_SCENES: [SceneName; 3] = [SceneName::Uniform, SceneName::Mixed, SceneName::Pile];
const QUICK_SIZES: [usize; 5] = [64, 256, 1_000, 2_000, 8_192];

const EFFORT: Effort = Effort { least_frames: 5, most_frames: 60, time: Duration::from_millis(60) };
const QUICK_EFFORT: Effort =
    Effort { least_frames: 3, most_frames: 20, time: Duration::from_millis(15) };
/// A load above this share of the cores is warned of: measured times would hold other processes'
/// work.
const BUSY_SHARE: f64 = 0.5;

/// Measure what engines take on this machine, for the plan
#[derive(Debug, Args)]
#[command(after_help = "\
Every CPU engine culls scenes of 64 to 524,288 boxes on one to all cores, interleaved, and a robust
fit gives the constants of the plan's cost model. They are kept in the user's cache directory, in a
file for this processor, instruction set and number of cores, and used by daemons and in-process
sessions from their next start on. It takes 10 to 30 seconds; let the machine be idle.

Examples:
  pairmaskd calibrate
  pairmaskd calibrate --dry-run --json          measure, keep nothing
  pairmaskd calibrate --isa avx2                 for daemons and sessions that use AVX2
  pairmaskd calibrate --out world.toml          then serve --calibration world.toml")]
pub struct Calibrate {
    /// Keep the constants in this file instead
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Keep nothing, print the file
    #[arg(long, conflicts_with = "out")]
    dry_run: bool,
    /// Few scenes and frames: about a second, for a look
    #[arg(long)]
    quick: bool,
    /// Threads at most [default: all cores; one where the machine is busy]
    #[arg(long, value_parser = whole_number::<std::num::NonZeroUsize>, value_name = "N")]
    threads: Option<std::num::NonZeroUsize>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Why no constants were measured.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    #[error(transparent)]
    Measure(#[from] MeasureError),
    #[error("no cache directory: set HOME or XDG_CACHE_HOME, or name a file with --out")]
    NoFolder,
    #[error(transparent)]
    Write(#[from] FileError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// The JSON object of `calibrate --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    /// Key of the machine that the constants belong to.
    key: String,
    /// The file that the constants were written to, if any.
    file: Option<PathBuf>,
    /// Processes that wanted a core at the start, over the cores.
    load_share: Option<f64>,
    /// ns a unit, by term.
    ns: BTreeMap<&'static str, f64>,
    /// By engine.
    threads: BTreeMap<&'static str, Threads>,
    /// Of a client that visits pairs.
    visit: Threads,
    /// Times measured.
    rows: usize,
    /// Predicted over measured of all rows: half of them are nearer to 1.
    median_error: f64,
    /// The same before the fit, with the built-in constants.
    built_in_median_error: f64,
}

#[derive(Debug, Serialize)]
struct Threads {
    serial_share: f64,
    fan_out_ns: f64,
}

/// Load of the last minute over the cores, where the system reports it.
fn load_share() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    let load: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(load / core_count() as f64)
}

impl Calibrate {
    /// Measures, fits, and writes the constants of an instruction set.
    pub fn run(&self, isa: AvailableIsa) -> Result<(), CalibrateError> {
        let machine = MachineKey::with_isa(isa.get());
        let path = match (&self.out, self.dry_run) {
            (_, true) => None,
            (Some(path), _) => Some(path.clone()),
            (None, _) => Some(default_path(&machine).ok_or(CalibrateError::NoFolder)?),
        };
        let load_share = load_share();
        if let Some(share) = load_share.filter(|share| *share > BUSY_SHARE) {
            log::warn!(
                "the machine is busy (load {:.0} % of its cores): constants will be rough, and those of threads stay as they are built in",
                100.0 * share
            );
        }
        let is_busy = load_share.is_some_and(|share| share > BUSY_SHARE);
        let rows = self.measure(is_busy, isa)?;
        let built_in = Calibration::built_in(isa.get());
        let calibration = fit(&rows, &built_in);
        if let Some(path) = &path {
            store(path, &calibration, &machine).map_err(FileError::of(path, Access::Write))?;
        }
        if self.dry_run && !self.json {
            print_text(encode(&calibration, &machine).trim_end())?;
            return Ok(());
        }
        let of = |ThreadCost { serial_share, fan_out_ns }| Threads { serial_share, fan_out_ns };
        let threads =
            EngineName::CPU.map(|engine| (engine.as_str(), of(calibration.threads_of(engine))));
        let report = Report {
            machine: Machine::this(),
            key: machine.to_string(),
            file: path,
            load_share,
            ns: Term::ALL.map(|term| (term.as_str(), calibration.ns(term))).into(),
            threads: threads.into(),
            visit: of(calibration.visit_threads),
            rows: rows.len(),
            median_error: median_error(&rows, &calibration),
            built_in_median_error: median_error(&rows, &built_in),
        };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    /// The rows of all cases. On a busy machine, whose other cores are in use, only one thread is
    /// measured.
    fn measure(&self, is_busy: bool, isa: AvailableIsa) -> Result<Vec<FitRow>, CalibrateError> {
        let most = if is_busy { 1 } else { core_count() };
        let threads = thread_counts(self.threads.map_or(most, usize::from));
        let pools = Pools::new(&threads)?;
        let (cases, effort) = self.cases();
        let progress = progress_bar(cases.len() as u64, "measuring");
        let mut measured = Vec::new();
        for case in cases {
            measured.push(measure(case, WaySet::Fit, &threads, &pools, &effort, isa)?);
            progress.inc(1);
        }
        progress.finish_and_clear();
        Ok(rows(&measured))
    }

    fn cases(&self) -> (Vec<Case>, Effort) {
        let all = |scenes: &[SceneName], sizes: &[usize]| {
            let cases =
                scenes.iter().flat_map(|scene| sizes.iter().map(|n| Case { scene: *scene, n: *n }));
            cases.collect::<Vec<_>>()
        };
        if self.quick {
            return (all(&QUICK_SCENES, &QUICK_SIZES), QUICK_EFFORT);
        }
        let mut cases = all(&SCENES, &SIZES);
        cases.extend(all(&LARGE_SCENES, &LARGE_SIZES));
        (cases, EFFORT)
    }
}

/// The median over the rows of the factor by which a prediction is too large or too small, less 1.
fn median_error(rows: &[FitRow], calibration: &Calibration) -> f64 {
    let mut errors: Vec<f64> = rows
        .iter()
        .map(|row| row.predicted_ns(calibration) / row.measured_ns)
        .map(|ratio| ratio.max(1.0 / ratio) - 1.0)
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(0.0)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.key)?;
        for (term, ns) in &self.ns {
            writeln!(f, "{term:<20} {ns:>12.4} ns")?;
        }
        let all = self.threads.iter().map(|(engine, threads)| (*engine, threads));
        for (who, Threads { serial_share, fan_out_ns }) in all.chain([("visit", &self.visit)]) {
            writeln!(f, "{who:<20} {serial_share:>12.2} serial, {fan_out_ns:.0} ns to fan out")?;
        }
        write!(
            f,
            "{} times; half are predicted within {:.0} % (built-in constants: {:.0} %)",
            self.rows,
            100.0 * self.median_error,
            100.0 * self.built_in_median_error
        )?;
        if let Some(file) = &self.file {
            write!(f, "\nkept in {}", file.display())?;
        }
        Ok(())
    }
}
