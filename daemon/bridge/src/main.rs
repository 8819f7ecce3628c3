//! `pairmask-bridge`: joins the shared scenes of several machines.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let arguments = cli::Arguments::parse();
    let level = if arguments.is_quiet() { "error" } else { "info" };
    env_logger::Builder::from_env(
        env_logger::Env::default()
            .default_filter_or(format!("pairmask_bridge={level},pairmask={level},zenoh=error")),
    )
    .init();
    match cli::run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("pairmask-bridge: {error}");
            ExitCode::FAILURE
        }
    }
}
