//! `mapping`, `grid` and `sweep`: studies of ways on a GPU beside the papers' figures.

use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{make_folder, spinner};
use pairmaskd::cli::whole_number::whole_number;

use crate::study::harness::{Print, Report, StudyError, deliver};
use crate::study::{grid, mapping, sweep};

/// What all studies on a GPU take.
#[derive(Debug, Args)]
struct Common {
    #[command(flatten)]
    options: DaemonOptions,
    /// Small sizes and few runs: seconds, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Folder for the results as JSON, CSV and Markdown
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

impl Common {
    fn run<R: Report>(
        &self,
        measure: impl FnOnce() -> Result<R, StudyError>,
    ) -> Result<(), StudyError> {
        make_folder(self.out.as_deref())?;
        let progress = spinner("measuring");
        let report = measure()?;
        progress.finish_and_clear();
        let print = if self.json { Print::Json } else { Print::Text };
        deliver(&report, self.out.as_deref(), print)
    }
}

/// Numbers of boxes with --quick.
const QUICK_COUNTS: [u32; 1] = [1_000];

/// Error and time of the ways from a pair's number k to the pair (a, b), beside the paper's
#[derive(Debug, Args)]
#[command(after_help = "\
Variants: the closed form with sqrt; Carmack's and Lomont's constants with 1 to 4 Newton steps;
each with and without the paper's two corrections; from the far end with one integer fix-up; row
search; rectangle fold; one inverse a word, then stepping; the lazy k/N, k%N.

Errors are counted on the CPU and the GPU, times taken by the GPU's own clock. With --gpu none, or
where there is no GPU, the CPU alone is measured. Without --quick it takes minutes.

Examples:
  pairmask-lab mapping --quick
  pairmask-lab mapping --out records         mapping.csv, mapping.json and mapping.md
  pairmask-lab mapping --gpu software --json")]
pub struct Mapping {
    #[command(flatten)]
    common: Common,
}

impl Mapping {
    pub fn run(&self, config: &Config) -> Result<(), StudyError> {
        let Common { options, quick, .. } = &self.common;
        self.common.run(|| mapping::measure(&options.gpu(config), *quick))
    }
}

/// The GPU's grid, stage by stage, with and without it, beside the paper's figures
#[derive(Debug, Args)]
#[command(after_help = "\
Table 6 (update of boxes, update of the grid, pairs), table 7 (with and without the grid, and where
they cross), figure 5 (against the CPU's engines) and figure 6 (share of boxes that move) of Avril et
al. 2012; GPU time by stage against what its memory traffic takes at least. Every scene's first and
last mask are compared with the CPU's. Needs a GPU; no daemon is between.

Examples:
  pairmask-lab grid
  pairmask-lab grid --n 1000000,10000000 --out records     grid.json, grid.csv and grid.md
  pairmask-lab grid --gpu software --quick --json")]
pub struct Grid {
    #[command(flatten)]
    common: Common,
    /// Numbers of boxes
    #[arg(long, conflicts_with = "quick", value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 1_000_000])]
    n: Vec<u32>,
}

impl Grid {
    pub fn run(&self, config: &Config) -> Result<(), StudyError> {
        let Common { options, quick, .. } = &self.common;
        let counts = if *quick { &QUICK_COUNTS[..] } else { &self.n };
        self.common.run(|| grid::measure(&options.gpu(config), counts, *quick))
    }
}

/// Sweep and prune on the GPU beside the grid and all pairs there
#[derive(Debug, Args)]
#[command(after_help = "\
Lines, planes, long worlds, thin boxes, and the scenes of the benches: whether a sweep along one axis wins
anywhere (Liu et al. 2010, Avril et al. 2014). The GPU's clock by part; tests a box. Every engine's pairs
are compared with those of the cores' grid. Needs a GPU; no daemon is between.

Examples:
  pairmask-lab sweep
  pairmask-lab sweep --n 1000000 --out records     sweep.json, sweep.csv and sweep.md
  pairmask-lab sweep --gpu software --quick --json")]
pub struct Sweep {
    #[command(flatten)]
    common: Common,
    /// Numbers of boxes
    #[arg(long, conflicts_with = "quick", value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [10_000, 100_000, 1_000_000])]
    n: Vec<u32>,
}

impl Sweep {
    pub fn run(&self, config: &Config) -> Result<(), StudyError> {
        let Common { options, quick, .. } = &self.common;
        let counts = if *quick { &QUICK_COUNTS[..] } else { &self.n };
        self.common.run(|| sweep::measure(&options.gpu(config), counts, *quick))
    }
}
