//! `stress`: hard scenes, every engine against the oracle.

use std::num::NonZeroUsize;
use std::time::Duration;

use clap::Args;
use pairmask_core::EngineName;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{OutputError, print_json, print_text, progress_bar};
use pairmaskd::cli::whole_number::whole_number;

use crate::sabotage::Sabotage;
use crate::stress::{Cases, Entrant, ModeChoice, Roster, StressError, run};

/// Put every engine through hard scenes and compare with a naive oracle
#[derive(Debug, Args)]
#[command(after_help = "\
Scenes are drawn to go wrong: subnormals, −0, faces one ulp apart, touching, the ends of f32,
infinities, NaN in each slot, empty and flat boxes, unit boxes far from the origin, sixty decades of
sizes, sorted and reversed, cell and quantisation borders, spheres that touch, and mixtures of
those. Every engine, instruction set and encoding answers each, and every engine in every precision
mode: what overlaps must be found, what the mode's definition adds may be, no farther apart than the
mode states. The threads that call, those that cull and those that write boxes have any rounding modes
and denormal flags. A wrong answer prints its case, the first wrong pair and why that pair is in the
mask or not. What an engine leaves to another one, because too many boxes stand in one place, is
counted as skipped.

Examples:
  pairmask-lab stress --seconds 600
  pairmask-lab stress --engine cpu-grid,gpu-grid --gpu software
  pairmask-lab stress --mode q8,f16                 these modes and not the exact engines
  pairmask-lab stress --case 12345                  one case again

Exit status: 0 where every answer was right, 1 where one was not.")]
pub struct Stress {
    /// Seed of the run: the same cases in the same order [default: from the clock]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", conflicts_with = "case")]
    seed: Option<u64>,
    /// This case and no other
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N")]
    case: Option<u64>,
    /// How long
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 10)]
    seconds: u64,
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        default_value = "all",
        help = format!("all, {}, spheres; several with commas", EngineName::listed(", ")),
    )]
    engine: Vec<Entrant>,
    /// all, exact, q16, q8, f16, margin, f64; several with commas. Spheres are exact
    #[arg(long, value_name = "MODES", value_delimiter = ',', default_value = "all")]
    mode: Vec<ModeChoice>,
    /// Most threads of an engine [default: all]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N")]
    threads: Option<NonZeroUsize>,
    #[command(flatten)]
    options: DaemonOptions,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Break every engine (`lossy`) or mode (`inward`), to test that the checks notice.
    #[arg(long, hide = true, num_args = 0..=1, require_equals = true, default_missing_value = "lossy")]
    break_engine: Option<Sabotage>,
}

/// The engines did not pass, or could not be run.
#[derive(Debug, thiserror::Error)]
pub enum StressCommandError {
    #[error(transparent)]
    Stress(#[from] StressError),
    /// The report names the answers.
    #[error("wrong answers: each can be had again with the command beside it")]
    Wrong,
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl Stress {
    /// Runs the cases and reports.
    pub fn run(&self, config: &Config) -> Result<(), StressCommandError> {
        let threads = self.threads.or(std::thread::available_parallelism().ok());
        let roster = Roster {
            entrants: self.engine.clone(),
            modes: self.mode.clone(),
            threads: threads.map_or(1, usize::from),
            gpu: self.options.gpu(config),
            sabotage: self.break_engine,
        };
        let cases = match self.case {
            Some(seed) => Cases::One { seed },
            None => Cases::Run {
                seed: self.seed.unwrap_or_else(seed_of_the_clock),
                time: Duration::from_secs(self.seconds),
            },
        };
        let mut subjects = roster.subjects()?;
        let bar = progress_bar(self.seconds, "hard scenes");
        let report = run(&cases, &mut subjects, |count, time| {
            bar.set_position(time.as_secs());
            bar.set_message(format!("{count} cases"));
        });
        bar.finish_and_clear();
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        if report.is_clean() { Ok(()) } else { Err(StressCommandError::Wrong) }
    }
}

/// A seed from the clock, short enough to be typed again.
fn seed_of_the_clock() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(1, |time| u64::from(time.subsec_micros()) + 1_000_000 * (time.as_secs() % 1_000))
}
