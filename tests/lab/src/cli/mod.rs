//! The command line of the laboratory. `README.md` documents files and JSON.
//!
//! Settings are looked for where `pairmaskd` looks for them: flag, environment (`PAIRMASK_*`),
//! configuration file, default. Results go to stdout; progress, logs and errors to stderr.

mod accuracy;
pub(crate) mod load;
mod program;
mod soak;
mod stress;
mod studies;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use pairmaskd::cli::options::CommonOptions;
use pairmaskd::cli::shape::{ALL, Shape, shaped};
use pairmaskd::cli::{machine, output, program as process, serve};

use self::studies::Measured;
use crate::processes;

/// Measures and stresses the engines of pairmask.
#[derive(Debug, Parser)]
#[command(name = "pairmask-lab", version = machine::version(), after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    common: CommonOptions,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  pairmask-lab stress --seconds 60             engines and modes against an oracle, on hard scenes
  pairmask-lab stress --clients 8              the same scenes by eight clients of a daemon
  pairmask-lab accuracy --out report           precision modes: time beside extra pairs
  pairmask-lab load --rate closed,60,240       clients at a pace, several at a time
  pairmask-lab soak --seconds 7200             a mixed load on a daemon, and whether its worker stays flat
  pairmask-lab program city                    a client to record
  pairmask-lab papers --only-records           the papers' tables and figures, theirs beside ours

Exit status: 0 done; 1 it failed or a check failed; 2 the command line or configuration is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Stress(stress::Stress),
    Accuracy(Measured<accuracy::Accuracy>),
    Load(Measured<load::Load>),
    Soak(Measured<soak::Soak>),
    Mapping(Measured<studies::Mapping>),
    Grid(Measured<studies::Grid>),
    GpuScene(Measured<studies::GpuSceneBench>),
    Plan(Measured<studies::PlanBench>),
    Advice(Measured<studies::AdviceBench>),
    Threads(Measured<studies::ThreadsBench>),
    Spheres(Measured<studies::Spheres>),
    Papers(Measured<studies::Papers>),
    Program(program::Program),
    /// A client process of `load`, `soak` and `stress`.
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
        ("advice", &["instance", "runtime_dir"]),
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
    process::run(&command(), run)
}

fn run(Cli { common, command }: &Cli) -> crate::Result<()> {
    output::start_log("warn");
    let common = &if command.reads_config() { common.with_config_file()? } else { common.clone() };
    match command {
        Command::Stress(stress) => stress.run(common),
        Command::Load(load) => load.run(common),
        Command::Soak(soak) => soak.run(common),
        Command::Accuracy(accuracy) => accuracy.run(common),
        Command::Mapping(mapping) => mapping.run(common),
        Command::Grid(grid) => grid.run(common),
        Command::GpuScene(scene) => scene.run(common),
        Command::Plan(plan) => plan.run(common),
        Command::Advice(advice) => advice.run(common),
        Command::Threads(threads) => threads.run(common),
        Command::Spheres(spheres) => spheres.run(common),
        Command::Papers(papers) => papers.run(common),
        Command::Program(program) => program.run(common),
        Command::Client { job } => Ok(processes::work(job)?),
        Command::Serve(serve) => Ok(serve.run(common, None)?),
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

#[cfg(test)]
mod tests {
    use pairmask_tests::command_line::{check_numbers, check_shared};

    use super::*;

    #[test]
    fn every_command_takes_what_is_shared_and_every_number_says_what_it_must_be() {
        command().debug_assert();
        SHAPE.without_use.iter().for_each(|(name, _)| check_shared(&command(), name));
        let tried = check_numbers(&command());
        assert!(tried > 60, "{tried}");
    }
}
