//! `mapping`: the mapping function study of Avril et al. 2012, error beside time.

use std::path::PathBuf;

use clap::Args;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{make_folder, print_text, spinner};

use super::error::LabError;
use crate::study::mapping::{MappingOptions, run_and_print};

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
    options: DaemonOptions,
    /// Small sizes and few runs: seconds, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Folder for mapping.csv, mapping.json and mapping.md
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

impl Mapping {
    pub fn run(&self, config: &Config) -> Result<(), LabError> {
        let options = MappingOptions {
            gpu: self.options.gpu(config),
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
