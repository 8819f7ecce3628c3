//! The command line: one file a subcommand. `CLI.md` documents it, its files and its JSON.
//!
//! A setting is looked for in this order: flag, environment (`PAIRMASK_*`), configuration file,
//! default. Results go to stdout; progress, logs and errors to stderr, an error as one line.

mod advise;
pub mod bench;
mod clean;
mod completions;
pub mod config;
mod cull;
mod demo;
mod doctor;
mod explain;
mod gpus;
mod group;
mod install_service;
pub mod machine;
mod man;
mod memory_size;
mod metrics;
pub mod object_files;
pub mod options;
pub mod output;
pub mod program;
pub mod progress;
mod rates;
mod replay;
mod scene;
mod scene_look;
pub mod serve;
pub mod shape;
mod skipped;
mod status;
pub mod target;
mod terminal;
mod top;
pub mod usage;
pub mod whole_number;

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use self::options::CommonOptions;
use self::program::Result;
use crate::publish::AlterAnswer;

/// Finds the overlapping pairs of boxes for other processes, through shared memory.
#[derive(Debug, Parser)]
#[command(name = "pairmaskd", version = machine::version(), after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    common: CommonOptions,
    #[command(flatten)]
    loudness: Loudness,
    #[command(subcommand)]
    command: Command,
}

/// How much is logged, of this process and of those that it starts.
#[derive(Clone, Copy, Debug, Args)]
struct Loudness {
    /// Log more, as `PAIRMASK_LOG=debug`
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Log errors alone, as `PAIRMASK_LOG=error`
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
}

const EXAMPLES: &str = "\
Examples:
  pairmaskd demo                              a daemon and a client with falling boxes, 10 s
  pairmaskd serve --instance world            serve until Ctrl-C
  pairmaskd status                            who serves, and what it did so far
  pairmaskd top                               its clients and scenes, as they are served
  pairmaskd doctor                            what of this machine is wrong, and what to do
  pairmaskd cull boxes.f32 --spawn --json     pairs of a file of boxes, by a daemon of its own
  pairmaskd bench latency --n 1000,10000      what a frame costs, by stage
  pairmaskd replay game.pmrec                 what clients sent, again, with the answers compared
  pairmaskd advise game.pmrec                 which session serves it soonest, and the lines to write
  pairmaskd explain boxes.f32 3 17            why two boxes are a pair or not

Exit status: 0 done; 1 it failed, a check failed, or no daemon serves; 2 the command line or configuration is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Serve(serve::Serve),
    Cull(cull::Cull),
    Demo(demo::Demo),
    /// Measure what frames cost on this machine
    #[command(
        subcommand,
        after_help = "Engines, precision modes, clients at a pace and pair numberings are measured by `pairmask-lab` (tests/lab)."
    )]
    Bench(bench::Bench),
    Scene(scene::Scene),
    Status(status::Status),
    Top(top::Top),
    Replay(replay::Replay),
    Advise(advise::Advise),
    Explain(explain::Explain),
    Doctor(doctor::Doctor),
    Gpus(gpus::Gpus),
    Clean(clean::Clean),
    InstallService(install_service::InstallService),
    Completions(completions::Completions),
    Man(man::Man),
}

/// Runs the command line. Call it first in `main`: it sets the process up.
pub fn main() -> ExitCode {
    program::run(&shape::command(), |cli| run(cli, None))
}

/// As [`main`], but a daemon that this process serves changes its answers: for tests of the auditor.
/// The daemon's worker runs the same binary, and so the same function.
pub fn main_altering(alter: AlterAnswer) -> ExitCode {
    program::run(&shape::command(), |cli| run(cli, Some(alter)))
}

fn run(cli: &Cli, alter_answers: Option<AlterAnswer>) -> Result {
    let Cli { common, loudness, command } = cli;
    match loudness {
        Loudness { verbose: true, .. } => program::set_variable(output::LOG_VARIABLE, "debug"),
        Loudness { quiet: true, .. } => program::set_variable(output::LOG_VARIABLE, "error"),
        Loudness { .. } => {}
    }
    output::start_log(command.log_level());
    let common = &if command.reads_config() { common.with_config_file()? } else { common.clone() };
    match command {
        Command::Serve(serve) => Ok(serve.run(common, alter_answers)?),
        Command::Cull(cull) => cull.run(common),
        Command::Demo(demo) => demo.run(common),
        Command::Bench(bench::Bench::Latency(latency)) => latency.run(common),
        Command::Scene(scene) => scene.run(),
        Command::Status(status) => status.run(common),
        Command::Top(top) => top.run(common),
        Command::Replay(replay) => replay.run(common),
        Command::Advise(advise) => advise.run(common),
        Command::Explain(explain) => explain.run(),
        Command::Doctor(doctor) => doctor.run(common),
        Command::Gpus(gpus) => gpus.run(),
        Command::Clean(clean) => clean.run(common),
        Command::InstallService(install) => install.run(common),
        Command::Completions(completions) => completions.run(),
        Command::Man(man) => man.run(),
    }
}

impl Command {
    /// Whether the command uses a setting of the configuration file. A command that uses none does
    /// not fail by a wrong file; a worker gets every setting from its supervisor, as a flag.
    const fn reads_config(&self) -> bool {
        match self {
            Self::Scene(_)
            | Self::Explain(_)
            | Self::Gpus(_)
            | Self::Completions(_)
            | Self::Man(_) => false,
            Self::Serve(serve) => !serve.is_worker(),
            _ => true,
        }
    }

    /// The log level where `PAIRMASK_LOG` is not set.
    const fn log_level(&self) -> &'static str {
        match self {
            Self::Serve(_) => "info",
            _ => "warn",
        }
    }
}
