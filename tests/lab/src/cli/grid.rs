//! `grid`: the grid study of Avril et al. 2012, stage by stage.

use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{make_folder, print_text, spinner};
use pairmaskd::cli::whole_number::whole_number;

use super::error::LabError;
use crate::study::grid::{GridOptions, run_and_print};

/// Numbers of boxes with --quick.
const QUICK_COUNTS: [u32; 1] = [1_000];

/// The GPU's grid, stage by stage, with and without it, beside the paper's figures
#[derive(Debug, Args)]
#[command(after_help = "\
Table 6 (update of boxes, update of the grid, pairs), table 7 (with and without the grid, and where
they cross), figure 5 (against the CPU's engines) and figure 6 (share of boxes that move) of Avril et
al. 2012; GPU time by stage against what its memory traffic takes at least. Every scene's first and
last mask are compared with the CPU's. Needs a GPU; no daemon is between.

Examples:
  pairmask-lab grid
  pairmask-lab grid --n 1000000,10000000 --out records     grid.json and grid.md
  pairmask-lab grid --gpu software --quick --json")]
pub struct Grid {
    #[command(flatten)]
    options: DaemonOptions,
    /// Numbers of boxes
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 1_000_000])]
    n: Vec<u32>,
    /// Small scenes and few runs: seconds, for a look. Times mean little
    #[arg(long, conflicts_with = "n")]
    quick: bool,
    /// Folder for grid.json and grid.md
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

impl Grid {
    pub fn run(&self, config: &Config) -> Result<(), LabError> {
        let options = GridOptions {
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
