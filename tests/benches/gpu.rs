//! Measures the GPU engines on a device. Needs only a Vulkan driver.

use std::error::Error;
use std::io::stdout;
use std::time::Duration;

use clap::{Parser, ValueEnum};
use pairmask_lab::gpu_stages::{BenchOptions, run, run_grid};
use pairmaskd::execute::gpu::GpuChoice;

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Check {
    Yes,
    No,
    /// Nothing is measured
    Only,
}

/// The GPU's stages and the ways up, on a device or on a software driver.
#[derive(Parser)]
#[command(name = "gpu")]
struct Options {
    #[arg(long)]
    gpu: Option<GpuChoice>,
    #[arg(long, value_delimiter = ',')]
    n: Vec<u32>,
    /// Time for each measurement, ms
    #[arg(long)]
    ms: Option<u64>,
    #[arg(long)]
    sweep: bool,
    /// Whether masks are compared with the CPU's
    #[arg(long, value_enum, default_value_t = Check::Yes)]
    check: Check,
    /// The stages of the grid
    #[arg(long)]
    grid: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let asked = Options::parse();
    let mut options = BenchOptions { sweep: asked.sweep, ..BenchOptions::default() };
    options.gpu = asked.gpu.unwrap_or(options.gpu);
    options.budget = asked.ms.map_or(options.budget, Duration::from_millis);
    options.check = asked.check != Check::No;
    options.measure = asked.check != Check::Only;
    if !asked.n.is_empty() {
        options.counts = asked.n;
    }
    let run = if asked.grid { run_grid } else { run };
    run(&options, &mut stdout().lock())
}
