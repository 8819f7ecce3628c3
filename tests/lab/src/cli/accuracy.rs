//! `accuracy`: run time against error, row by row.

use std::time::Duration;

use clap::Args;
use pairmask_core::dispatch::CullOptions;
use pairmask_core::{BoxCount, EngineChoice};
use pairmaskd::cli::options::{CommonOptions, CullFlags, DaemonOptions};
use pairmaskd::cli::progress::progress_bar;
use pairmaskd::cli::target::Target;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{GpuChoice, choose, list_adapters};
use pairmaskd::scene::SceneName;

use super::studies::Study;
use crate::Result;
use crate::study::accuracy::measure::{self, Lengths, Subject};
use crate::study::accuracy::mode::StudyMode;
use crate::study::accuracy::report::report;
use crate::study::harness::{Report, machine_with};

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
  spheres                spheres around the boxes, culled in this process, compared with the exact
                         pairs of spheres, and with the boxes' pairs apart

Above the rows stands what each mode costs, and where it is on the Pareto front of time, extra pairs and
bytes up.

Examples:
  pairmask-lab accuracy --scene uniform,pile --n 10000,100000
  pairmask-lab accuracy --precision f64=1e6,plain-f32=1e6
  pairmask-lab accuracy --out report")]
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
    /// exact, q16, q8, f16, margin=X, f64=X, plain-f32=X, spheres
    #[arg(
        long,
        value_name = "MODE,..",
        value_delimiter = ',',
        default_value = "exact,q16,q8,f16,margin=0.1,f64,plain-f32,spheres"
    )]
    precision: Vec<StudyMode>,
    /// Engines, a row each, in place of --engine
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    engines: Vec<EngineChoice>,
    #[command(flatten)]
    lengths: Lengths,
    /// Seed of the scenes
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl Study for Accuracy {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let engines = match &self.engines[..] {
            [] => vec![self.options.engine(common)],
            engines => engines.to_vec(),
        };
        let mut subjects = Vec::new();
        for &scene in &self.scene {
            for &n in &self.n {
                for &mode in &self.precision {
                    for &engine in &engines {
                        let options = CullOptions { engine, ..self.options.cull_options(common) };
                        subjects.push(Subject { scene, n, mode, options, seed: self.seed });
                    }
                }
            }
        }
        subjects.retain(measure::is_reasonable);
        if subjects.is_empty() {
            return Err("no row: every engine asked for would take too long on every scene".into());
        }
        let progress = progress_bar(subjects.len() as u64, "rows");
        let choice = self.daemon.gpu(common);
        // Listing adapters loads every driver, and some print on stderr: not where no GPU is used.
        let adapters = if choice == GpuChoice::None { Vec::new() } else { list_adapters() };
        // The adapter that a daemon of this choice uses.
        let adapter = choose(&choice, &adapters).and_then(|at| adapters.get(at));
        let machine = machine_with(adapter);
        let target = Target::new(&self.options, &self.daemon, SPIN, 1, common)?;
        let mut rows = Vec::new();
        for subject in &subjects {
            let builder = self.options.session(common).engine(subject.options.engine);
            let builder = target.session(builder, SPIN).capacity(BoxCount::new(subject.n));
            let memory_bytes = || target.memory_bytes();
            rows.push(measure::row(builder.connect()?, subject, &self.lengths, memory_bytes)?);
            progress.inc(1);
        }
        Ok(report(machine, self.seed, &rows))
    }
}
