//! The command line of the laboratory: one file a measurement. `README.md` documents files and JSON.
//!
//! Settings are looked for where `pairmaskd` looks for them: flag, environment (`PAIRMASK_*`),
//! configuration file, default. Results go to stdout; progress, logs and errors to stderr.

mod accuracy;
mod chart;
mod error;
mod gpu_scene;
mod gpu_studies;
mod load;
mod papers;
mod plan;
mod scenes;
mod shape;
mod spheres;
mod stress;
mod threads;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::Place;
use pairmaskd::cli::{build, output, program, serve};

use self::error::LabError;

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
  pairmask-lab sweep --gpu software --quick    sweep and prune on the GPU beside the grid
  pairmask-lab gpu-scene --moving 1 --stages   scenes that persist in video memory
  pairmask-lab spheres --errors                what plain f32 gets wrong
  pairmask-lab papers --only-records           the papers' tables and figures, theirs beside ours
  pairmask-lab chart r.json --x n --y p50      rows of a report as lines of an SVG file

Exit status: 0 done; 1 it failed or a check failed; 2 the command line or configuration is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Stress(stress::Stress),
    #[command(hide = true)]
    StressClient(stress::StressClient),
    Accuracy(accuracy::Accuracy),
    Load(load::Load),
    #[command(hide = true)]
    LoadClient(load::LoadClient),
    Mapping(gpu_studies::Mapping),
    Grid(gpu_studies::Grid),
    Sweep(gpu_studies::Sweep),
    GpuScene(gpu_scene::GpuSceneBench),
    Plan(plan::PlanBench),
    Threads(threads::ThreadsBench),
    Spheres(spheres::Spheres),
    Papers(papers::Papers),
    Chart(chart::Chart),
    /// The daemon of a measurement: that of `pairmaskd`.
    #[command(hide = true)]
    Serve(serve::Serve),
}

/// Runs the command that the process was started with.
///
/// Call it first in `main`: it sets the process up.
pub fn main() -> ExitCode {
    program::run(&shape::command(), run)
}

fn run(cli: &Cli) -> Result<(), LabError> {
    let Cli { place, command } = cli;
    output::start_log("warn");
    let config =
        if command.reads_config() { Config::load(place.config_file())? } else { Config::default() };
    match command {
        Command::Stress(stress) => Ok(stress.run(place, &config)?),
        Command::StressClient(client) => Ok(client.run(place)?),
        Command::Load(load) => Ok(load.run(place, &config)?),
        Command::LoadClient(client) => Ok(client.run(place, &config)?),
        Command::Accuracy(accuracy) => Ok(accuracy.run(place, &config)?),
        Command::Mapping(mapping) => Ok(mapping.run(&config)?),
        Command::Grid(grid) => Ok(grid.run(&config)?),
        Command::Sweep(sweep) => Ok(sweep.run(&config)?),
        Command::GpuScene(scene) => scene.run(&config),
        Command::Plan(plan) => plan.run(place, &config),
        Command::Threads(threads) => Ok(threads.run()?),
        Command::Spheres(spheres) => Ok(spheres.run()?),
        Command::Papers(papers) => Ok(papers.run()?),
        Command::Chart(chart) => Ok(chart.run()?),
        Command::Serve(serve) => Ok(serve.run(place, &config, None)?),
    }
}

impl Command {
    /// Whether the command uses a setting of the configuration file. A command that uses none does
    /// not fail by a wrong file. The process that starts a daemon or a client passes every setting as a
    /// flag.
    const fn reads_config(&self) -> bool {
        !matches!(
            self,
            Self::Threads(_)
                | Self::Spheres(_)
                | Self::Papers(_)
                | Self::Chart(_)
                | Self::StressClient(_)
                | Self::Serve(_)
        )
    }
}
