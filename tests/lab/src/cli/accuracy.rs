//! `accuracy`: run time against error, row by row.

use std::fs;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use indicatif::ProgressBar;
use pairmask_core::dispatch::CullOptions;
use pairmask_core::{BoxCount, EngineChoice};
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::{CullFlags, DaemonOptions, Place};
use pairmaskd::cli::output::{OutputError, make_folder, print_text, progress_bar, spinner};
use pairmaskd::cli::target::Target;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{GpuChoice, choose, list_adapters};
use pairmaskd::file_error::{Access, FileError};
use pairmaskd::scene::SceneName;

use crate::study::accuracy::judge::{Assertion, regressions};
use crate::study::accuracy::measure::{self, Lengths, Subject};
use crate::study::accuracy::mode::StudyMode;
use crate::study::accuracy::rows::AccuracyReport;
use crate::study::accuracy::variants::{self, VariantChoice};
use crate::study::harness::machine::Machine;
use crate::study::harness::{Print, StudyError, deliver};

/// Spin time of both sides. Longer than any pause between two frames, so that no thread sleeps.
const SPIN: Duration = Duration::from_secs(1);

/// Run time against error: scenes by sizes by precision modes by engines
#[derive(Debug, Args)]
#[command(after_help = "\
Every row is a scene in motion, timed frame by frame; some frames are compared with the exact pairs,
found in another way. No mode may miss a pair.

Modes beside those of a session:
  f64=X                  the scene X units from the origin of a world in f64, its boxes sent relative
                         to an origin among them and compared with the exact pairs in f64 [X: 1e9]
  plain-f32=X            the same, each coordinate rounded to the nearest f32, as a warning
  spheres=circumscribed  spheres around the boxes, culled in this process, compared with the exact
                         pairs of spheres, and with the boxes' pairs apart
  spheres=inscribed      spheres within the boxes

Below the rows stand the modes that are on the Pareto front of time, extra pairs and bytes up, and
those that are nowhere on it; then the papers' ways to turn a pair's number into the pair (--mapping):
time and wrong pairs at every n. None of those serves a client.

--assert takes limits that every row but plain-f32's has to keep, and the exit status is 1 where one does not:
FIGURE=X, FIGURE<X or FIGURE<=X with the figures missed, extra, extra_ratio, p50, p99 (of whole
frames), bytes_up, bytes_down, memory and the units ns, us, ms, s, %, KiB, MiB, GiB.

Examples:
  pairmask-lab accuracy --scene uniform,pile --n 10000,100000
  pairmask-lab accuracy --n 1000 --mapping none --assert 'missed=0,p99<2ms'
  pairmask-lab accuracy --precision f64=1e6,plain-f32=1e6 --mapping none
  pairmask-lab accuracy --out before; ...; pairmask-lab accuracy --compare before/accuracy.json")]
pub struct Accuracy {
    #[command(flatten)]
    options: CullFlags,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Scenes
    #[arg(long, value_name = "NAME,..", value_delimiter = ',',
        default_values_t = [SceneName::Uniform, SceneName::Mixed, SceneName::Pile, SceneName::Plane])]
    scene: Vec<SceneName>,
    /// Numbers of boxes
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1000, 10_000, 100_000])]
    n: Vec<u32>,
    /// exact, q16, q8, f16, margin=X, f64=X, plain-f32=X, spheres=circumscribed, spheres=inscribed
    #[arg(long, value_name = "MODE,..", value_delimiter = ',', default_values_t = default_modes())]
    precision: Vec<StudyMode>,
    /// Engines, a row each, in place of --engine
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    engines: Vec<EngineChoice>,
    /// Frames that are timed
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "100")]
    frames: NonZeroU32,
    /// Frames before those
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 10)]
    warm_up: u32,
    /// Timed frames whose pairs are compared with the exact ones, after the clock has stopped
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 4)]
    checked: u32,
    /// Seed of the scenes
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Limits that every row has to keep, such as 'missed=0,p99<2ms'
    #[arg(long, value_name = "LIMITS")]
    assert: Option<Assertion>,
    /// Say what is slower or wronger than in this report
    #[arg(long, value_name = "OLD.json")]
    compare: Option<PathBuf>,
    /// Ways to turn a pair's number into the pair: all, none, or names
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = [VariantChoice::All])]
    mapping: Vec<VariantChoice>,
    /// Write accuracy.json, accuracy.csv, mapping.csv and report.html into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV
    #[arg(long)]
    csv: bool,
}

/// All kinds of modes.
fn default_modes() -> Vec<StudyMode> {
    let names = ["exact", "q16", "q8", "f16", "margin=0.1", "f64", "plain-f32", "spheres"];
    names.iter().filter_map(|name| name.parse().ok()).collect()
}

impl Accuracy {
    /// Measures every row, writes the report, and checks it against limits and the old report.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), StudyError> {
        // Read before the measurement, so that a wrong file fails at once.
        let old = self.compare.as_deref().map(read_report).transpose()?;
        make_folder(self.out.as_deref())?;
        let report = self.measure(place, config)?;
        let print = match (self.json, self.csv) {
            (true, _) => Print::Json,
            (false, true) => Print::Csv,
            (false, false) => Print::Text,
        };
        deliver(&report, self.out.as_deref(), print)?;
        if let (Some(old), Some(path)) = (&old, &self.compare) {
            let lines = regressions(&report, old)
                .ok_or_else(|| StudyError::NothingInCommon { path: path.clone() })?;
            self.say("worse", &lines)?;
        }
        let failures = self.assert.as_ref().map(|a| a.failures(&report.rows)).unwrap_or_default();
        self.say("not kept", &failures)?;
        match &failures[..] {
            [] => Ok(()),
            [first, ..] => {
                Err(StudyError::Assertion { failures: failures.len(), first: first.clone() })
            }
        }
    }

    /// Prints lines beside the report: below the table, or on stderr where stdout is for programs.
    fn say(&self, what: &str, lines: &[String]) -> Result<(), OutputError> {
        for line in lines {
            if self.json || self.csv {
                log::warn!("{what}: {line}");
            } else {
                print_text(&format!("{what}: {line}"))?;
            }
        }
        Ok(())
    }

    fn subjects(&self, config: &Config) -> Vec<Subject> {
        let engines = match &self.engines[..] {
            [] => vec![self.options.engine(config)],
            engines => engines.to_vec(),
        };
        let mut subjects = Vec::new();
        for &scene in &self.scene {
            for &n in &self.n {
                for &mode in &self.precision {
                    for &engine in &engines {
                        let options = CullOptions { engine, ..self.options.cull_options(config) };
                        subjects.push(Subject { scene, n, mode, options, seed: self.seed });
                    }
                }
            }
        }
        subjects.retain(measure::is_reasonable);
        subjects
    }

    fn measure(&self, place: &Place, config: &Config) -> Result<AccuracyReport, StudyError> {
        let subjects = self.subjects(config);
        if subjects.is_empty() {
            return Err(StudyError::NoRow);
        }
        let machine = machine(&self.daemon.gpu(config));
        let target = Target::new(&self.options, &self.daemon, SPIN, place, config)?;
        let lengths =
            Lengths { warm_up: self.warm_up, frames: self.frames.get(), checked: self.checked };
        let progress: ProgressBar = progress_bar(subjects.len() as u64, "rows");
        let mut rows = Vec::new();
        for subject in &subjects {
            let builder = self.options.session(place, config).engine(subject.options.engine);
            let builder = target.session(builder, SPIN).capacity(BoxCount::new(subject.n));
            let memory_bytes = || target.memory_bytes();
            rows.push(measure::row(builder.connect()?, subject, &lengths, memory_bytes)?);
            progress.inc(1);
        }
        progress.finish_and_clear();
        let progress = spinner("mapping functions");
        let variants = variants::measure(&self.mapping, &self.n, &self.daemon.gpu(config))?;
        progress.finish_and_clear();
        Ok(AccuracyReport::new(machine, self.seed, rows, variants))
    }
}

/// This machine, with the adapter that a daemon of this choice uses.
fn machine(choice: &GpuChoice) -> Machine {
    // Listing adapters loads every driver, and some print on stderr: no driver is loaded where no
    // GPU is used.
    let adapters = if *choice == GpuChoice::None { Vec::new() } else { list_adapters() };
    Machine::here(choose(choice, &adapters).and_then(|at| adapters.get(at)))
}

fn read_report(path: &Path) -> Result<AccuracyReport, StudyError> {
    let text = fs::read_to_string(path).map_err(FileError::of(path, Access::Read))?;
    let no_report = |source| StudyError::NoReport { path: path.to_owned(), source };
    serde_json::from_str(&text).map_err(no_report)
}
