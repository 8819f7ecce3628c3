//! Measures the GPU engines on a device. Needs only a Vulkan driver.
//!
//! `gpu [--gpu auto|software|INDEX|NAME] [--n 1000,4096] [--ms 500] [--sweep] [--no-check | --check-only]`

use std::process::ExitCode;
use std::time::Duration;

use pairmask_lab::gpu_stages::{BenchOptions, run, run_grid};

fn main() -> ExitCode {
    let Some(options) = parse(std::env::args().skip(1)) else {
        eprintln!(
            "usage: gpu [--gpu CHOICE] [--n N,N,..] [--ms BUDGET] [--sweep] [--no-check|--check-only]"
        );
        return ExitCode::from(2);
    };
    let grid = std::env::args().any(|arg| arg == "--grid");
    match if grid { run_grid } else { run }(&options, &mut std::io::stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn parse(mut args: impl Iterator<Item = String>) -> Option<BenchOptions> {
    let mut options = BenchOptions::default();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--gpu" => options.gpu = args.next()?.parse().ok()?,
            "--n" => {
                let counts = args.next()?;
                options.counts =
                    counts.split(',').map(|n| n.parse().ok()).collect::<Option<_>>()?;
            }
            "--ms" => options.budget = Duration::from_millis(args.next()?.parse().ok()?),
            "--sweep" => options.sweep = true,
            "--no-check" => options.check = false,
            "--check-only" => options.measure = false,
            // Passed by `cargo bench`.
            "--bench" | "--grid" => {}
            _ => return None,
        }
    }
    Some(options)
}
