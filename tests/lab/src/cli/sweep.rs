//! `sweep`: sweep and prune on the GPU beside the grid and all pairs.

use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{make_folder, print_text, spinner};
use pairmaskd::cli::whole_number::whole_number;

use super::error::LabError;
use crate::study::sweep::{SweepOptions, run_and_print};

/// Numbers of boxes with --quick.
const QUICK_COUNTS: [u32; 1] = [1_000];

/// Sweep and prune on the GPU beside the grid and all pairs there
#[derive(Debug, Args)]
#[command(after_help = "\
Lines, planes, long worlds, thin boxes, and the scenes of the benches: whether a sweep along one axis wins
anywhere (Liu et al. 2010, Avril et al. 2014). The GPU's clock by part; tests a box. Every engine's pairs
are compared with those of the cores' grid. Needs a GPU; no daemon is between.

Examples:
  pairmask-lab sweep
  pairmask-lab sweep --n 1000000 --out records     sweep.json and sweep.md
  pairmask-lab sweep --gpu software --quick --json")]
pub struct Sweep {
    #[command(flatten)]
    options: DaemonOptions,
    /// Numbers of boxes
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [10_000, 100_000, 1_000_000])]
    n: Vec<u32>,
    /// Small scenes and few runs: seconds, for a look. Times mean little
    #[arg(long, conflicts_with = "n")]
    quick: bool,
    /// Folder for sweep.json and sweep.md
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

impl Sweep {
    pub fn run(&self, config: &Config) -> Result<(), LabError> {
        let options = SweepOptions {
            gpu: self.options.gpu(config),
            counts: if self.quick { QUICK_COUNTS.to_vec() } else { self.n.clone() },
            quick: self.quick,
            out: self.out.clone(),
            json: self.json,
        };
        make_folder(self.out.as_deref())?;
        let progress = spinner("measuring");
        let mut text = Vec::new();
        run_and_print(&options, &mut text)?;
        progress.finish_and_clear();
        Ok(print_text(String::from_utf8_lossy(&text).trim_end())?)
    }
}
