//! The command line of the laboratory. `README.md` documents files and JSON.
//!
//! Settings are looked for where `pairmaskd` looks for them: flag, environment (`PAIRMASK_*`),
//! configuration file, default. Results go to stdout; progress, logs and errors to stderr.

mod accuracy;
pub(crate) mod load;
mod stress;
mod studies;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use pairmaskd::cli::config::{Config, ConfigError};
use pairmaskd::cli::options::Place;
use pairmaskd::cli::output::OutputError;
use pairmaskd::cli::program::{FAILED, Failure, USAGE, WrongUsage, says_why};
use pairmaskd::cli::shape::{ALL, Shape, shaped};
use pairmaskd::cli::{build, output, program, serve};
use pairmaskd::serve::ServeError;
use pairmaskd::spawn::SpawnError;

use crate::{Fault, processes};

/// Measures and stresses the engines of pairmask.
#[derive(Debug, Parser)]
#[command(name = "pairmask-lab", version = build::version(), after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    place: Place,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  pairmask-lab stress --seconds 60             engines and modes against an oracle, on hard scenes
  pairmask-lab stress --clients 8              the same scenes by eight clients of a daemon
  pairmask-lab accuracy --out report           precision modes: time beside extra pairs
  pairmask-lab load --rate closed,60,240       clients at a pace, several at a time
  pairmask-lab plan --n 1000,100000            the planned engine beside the best one
  pairmask-lab threads --threads 1,2,4         speed-up by threads
  pairmask-lab mapping --quick                 ways from a pair's number to the pair
  pairmask-lab grid --gpu software --quick     the GPU's grid, stage by stage
  pairmask-lab gpu-scene --moving 1 --stages   scenes that persist in video memory
  pairmask-lab spheres --errors                what plain f32 gets wrong
  pairmask-lab papers --only-records           the papers' tables and figures, theirs beside ours

Exit status: 0 done; 1 it failed or a check failed; 2 the command line or configuration is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Stress(stress::Stress),
    Accuracy(accuracy::Accuracy),
    Load(load::Load),
    Mapping(studies::Mapping),
    Grid(studies::Grid),
    GpuScene(studies::GpuSceneBench),
    Plan(studies::PlanBench),
    Threads(studies::ThreadsBench),
    Spheres(studies::Spheres),
    Papers(studies::Papers),
    /// A client process of `load` and `stress`.
    #[command(hide = true)]
    Client {
        /// What it does, as JSON.
        job: String,
    },
    /// The daemon of a measurement: that of `pairmaskd`.
    #[command(hide = true)]
    Serve(serve::Serve),
}

const SHAPE: Shape = Shape {
    without_use: &[
        ("mapping", &["instance", "runtime_dir", "isa"]),
        ("grid", &["instance", "runtime_dir", "isa"]),
        ("gpu-scene", &["instance", "runtime_dir", "isa"]),
        ("plan", &["instance", "runtime_dir"]),
        ("threads", ALL),
        ("spheres", ALL),
        ("papers", ALL),
    ],
    measuring: &["accuracy", "load"],
};

fn command() -> clap::Command {
    shaped(Cli::command(), &SHAPE)
}

/// Runs the command of this process. Call it first in `main`: it sets the process up.
pub fn main() -> ExitCode {
    program::run(&command(), |cli| run(cli).map_err(LabError))
}

fn run(Cli { place, command }: &Cli) -> crate::Result<()> {
    output::start_log("warn");
    let config =
        if command.reads_config() { Config::load(place.config_file())? } else { Config::default() };
    match command {
        Command::Stress(stress) => stress.run(place, &config),
        Command::Load(load) => load.run(place, &config),
        Command::Accuracy(accuracy) => accuracy.run(place, &config),
        Command::Mapping(mapping) => mapping.run(&config),
        Command::Grid(grid) => grid.run(&config),
        Command::GpuScene(scene) => scene.run(&config),
        Command::Plan(plan) => plan.run(place, &config),
        Command::Threads(threads) => threads.run(),
        Command::Spheres(spheres) => spheres.run(),
        Command::Papers(papers) => papers.run(),
        Command::Client { job } => Ok(processes::work(job)?),
        Command::Serve(serve) => Ok(serve.run(place, &config, None)?),
    }
}

impl Command {
    /// A command that uses no setting does not fail by a wrong file; a child gets every setting as a flag.
    const fn reads_config(&self) -> bool {
        !matches!(
            self,
            Self::Threads(_)
                | Self::Spheres(_)
                | Self::Papers(_)
                | Self::Client { .. }
                | Self::Serve(_)
        )
    }
}

#[derive(Debug, thiserror::Error)]
#[error(transparent)]
struct LabError(Fault);

impl From<WrongUsage> for LabError {
    fn from(error: WrongUsage) -> Self {
        Self(error.into())
    }
}

impl From<OutputError> for LabError {
    fn from(error: OutputError) -> Self {
        Self(error.into())
    }
}

impl Failure for LabError {
    fn exit_code(&self) -> u8 {
        let is_usage = self.0.is::<WrongUsage>() || self.0.is::<ConfigError>();
        if is_usage || self.0.is::<load::TooManyClients>() { USAGE } else { FAILED }
    }

    fn was_said(&self) -> bool {
        says_why(match self.0.downcast_ref() {
            Some(ServeError::Worker { code }) => Some(*code),
            _ => self.0.downcast_ref().and_then(SpawnError::exit_code),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsString;

    use pairmaskd::cli::usage::one_line;

    use super::*;

    #[test]
    fn every_command_takes_what_is_shared() {
        command().debug_assert();
        for (name, _) in SHAPE.without_use {
            for flag in ["--runtime-dir", "--config", "--instance", "--isa"] {
                let words = ["pairmask-lab", flag, "x", name, "--help"];
                let error = command().try_get_matches_from(words).expect_err("help");
                assert_eq!(error.kind(), clap::error::ErrorKind::DisplayHelp, "{name} {flag}");
            }
        }
    }

    /// No message about a wrong number has Rust's words.
    #[test]
    fn every_number_says_what_it_must_be() {
        let mut built = command();
        built.build();
        let mut tried = 0;
        for inner in built.get_subcommands().filter(|inner| inner.get_name() != "help") {
            for arg in inner.get_arguments().filter(|arg| arg.get_action().takes_values()) {
                let Some(long) = arg.get_long() else { continue };
                for value in ["0", "-1", "x", "", "99999999999999999999999"] {
                    let words = ["pairmask-lab", inner.get_name(), &format!("--{long}={value}")];
                    let words = words.map(OsString::from);
                    let Err(error) = command().try_get_matches_from(&words) else { continue };
                    let text = one_line(&error, &command(), &words);
                    for jargon in [" type", "digit found", "cannot parse", "zero for", "not in "] {
                        assert!(!text.contains(jargon), "{words:?}: {text}");
                    }
                    tried += 1;
                }
            }
        }
        assert!(tried > 60, "{tried}");
    }
}
