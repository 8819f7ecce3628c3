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
mod hush;
mod options;
mod output;
mod percentiles;
mod raw_objects;
mod scene;
mod scene_look;
mod serve;
mod shape;
mod status;
mod stress;
mod usage;
mod whole;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{FromArgMatches, Parser, Subcommand};

use self::config::Config;
use self::error::CliError;
use self::options::Place;
use self::output::{OutputError, print_aside};

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
/// Call it first in `main`: it says how the process is set up.
pub fn main() -> ExitCode {
    hush::hush_drivers();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let done = parse(&arguments).and_then(|cli| cli.map_or(Ok(()), |cli| run(&cli)));
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is_closed_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            if !error.was_said() {
                print_aside(&format!("pairmaskd: {}", on_one_line(&error.to_string())));
            }
            ExitCode::from(error.exit_code())
        }
    }
}

/// What was asked for; `None` where that was help or the version, which stand on stdout then.
fn parse(arguments: &[OsString]) -> Result<Option<Cli>, CliError> {
    let command = shape::command();
    let matches = command.clone().try_get_matches_from(arguments);
    match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => Ok(Some(cli)),
        Err(error) if error.use_stderr() => {
            Err(CliError::Usage(usage::one_line(&error, &command, arguments)))
        }
        Err(help) => {
            help.print().map_err(OutputError::from)?;
            Ok(None)
        }
    }
}

/// Names that users give may hold anything, and an error is one line.
fn on_one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
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
    let config =
        if command.reads_config() { Config::load(place.config_file())? } else { Config::default() };
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
    /// Whether a setting of the configuration file means something for it: what reads none does not
    /// fail by a file that is wrong.
    const fn reads_config(&self) -> bool {
        match self {
            Self::Calibrate(_) | Self::Scene(_) | Self::Explain(_) => false,
            Self::Bench(bench) => bench.reads_config(),
            _ => true,
        }
    }

    /// What is logged unless `PAIRMASK_LOG` says otherwise.
    const fn log_level(&self) -> &'static str {
        match self {
            Self::Serve(_) => "info",
            _ => "warn",
        }
    }
}
