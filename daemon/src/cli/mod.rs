//! The command line: one file a subcommand. `CLI.md` documents it, its files and its JSON.
//!
//! A setting is looked for in this order: flag, environment (`PAIRMASK_*`), configuration file,
//! default. Results go to stdout; progress, logs and errors to stderr, an error as one line.

mod bench;
mod build;
mod calibrate;
mod config;
mod cull;
mod demo;
mod error;
mod explain;
mod options;
mod output;
mod percentiles;
mod raw_objects;
mod scene;
mod serve;
mod status;
mod stress;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use self::config::Config;
use self::error::CliError;
use self::options::Place;

/// Finds the overlapping pairs of boxes for other processes, through shared memory.
#[derive(Debug, Parser)]
#[command(name = "pairmaskd", version = build::version(), after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    place: Place,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  pairmaskd demo                              a daemon and a client with falling boxes, 10 s
  pairmaskd serve --instance world            serve until Ctrl-C
  pairmaskd status                            who serves, and what it did so far
  pairmaskd cull boxes.f32 --spawn --json     pairs of a file of boxes, by a daemon of its own
  pairmaskd bench latency --n 1000,10000      what a frame costs, by stage
  pairmaskd calibrate                         measure this machine, for the plan
  pairmaskd stress --seconds 60               engines and modes against an oracle, on hard scenes
  pairmaskd explain boxes.f32 3 17            why two boxes are a pair or not

Exit status: 0 done; 1 it failed, a check failed, or nobody serves; 2 the command line or configuration is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Serve(serve::Serve),
    Cull(cull::Cull),
    Demo(demo::Demo),
    #[command(hide = true)]
    DemoClient(demo::DemoClient),
    Bench(bench::Bench),
    Calibrate(calibrate::Calibrate),
    Scene(scene::Scene),
    Status(status::Status),
    Stress(stress::Stress),
    Explain(explain::Explain),
}

/// Runs the command that the process was started with.
///
/// A wrong command line, `--help` and `--version` end the process at once.
pub fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is_closed_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("pairmaskd: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

fn run(cli: &Cli) -> Result<(), CliError> {
    let Cli { place, command } = cli;
    output::start_log(command.log_level());
    if let Command::Serve(serve) = command
        && serve.is_worker()
    {
        // Its supervisor read the configuration and passes every setting on as a flag.
        return serve.run(place, &Config::default());
    }
    let config = Config::load(place.config_file())?;
    match command {
        Command::Serve(serve) => serve.run(place, &config),
        Command::Cull(cull) => Ok(cull.run(place, &config)?),
        Command::Demo(demo) => Ok(demo.run(place, &config)?),
        Command::DemoClient(client) => Ok(client.run(place, &config)?),
        Command::Bench(bench) => Ok(bench.run(place, &config)?),
        Command::Calibrate(calibrate) => Ok(calibrate.run()?),
        Command::Scene(scene) => Ok(scene.run()?),
        Command::Status(status) => Ok(status.run(place, &config)?),
        Command::Stress(stress) => Ok(stress.run(&config)?),
        Command::Explain(explain) => Ok(explain.run()?),
    }
}

impl Command {
    /// What is logged unless `PAIRMASK_LOG` says otherwise.
    const fn log_level(&self) -> &'static str {
        match self {
            Self::Serve(_) => "info",
            _ => "warn",
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::Cli;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
