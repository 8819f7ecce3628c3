//! `papers`: one page with every table and figure of the four papers, theirs beside ours.

use std::path::{Path, PathBuf};

use clap::Args;
use pairmaskd::cli::output::{make_folder, progress_bar};
use pairmaskd::execute::gpu::GpuChoice;

use crate::study::harness::{Print, StudyError, deliver};
use crate::study::papers::{PapersOptions, STEPS, make};

/// Where a checkout has its records.
const RECORDS: &str = "tests/records";

/// Every table and figure of the four papers, theirs beside ours: what holds, what breaks
#[derive(Debug, Args)]
#[command(after_help = "\
Ours are measured now; what this machine cannot measure (a GPU, two GPUs, many cores) is taken from
records, found by their file names below a folder, the newest folder first. Each row names its record, or this
run. A rule gives each claim its verdict: holds, breaks, or not measured. Without --quick it takes
minutes.

Examples:
  pairmask-lab papers --out report           papers.md, papers.html and papers.json
  pairmask-lab papers --gpu auto             the GPU's figures measured, too
  pairmask-lab papers --only-records         of records alone, in no time
  pairmask-lab papers --quick --json")]
pub struct Papers {
    /// The GPU to measure on: auto, software, a number of `pairmaskd status`, or part of a name
    /// [default: none, GPU figures are those of records]
    #[arg(long, value_name = "GPU")]
    gpu: Option<GpuChoice>,
    /// Small sizes and few runs: seconds, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Measure nothing
    #[arg(long, conflicts_with_all = ["gpu", "quick"])]
    only_records: bool,
    /// Folder of the folders of records [default: tests/records of the checkout, where it is there]
    #[arg(long, value_name = "DIR")]
    from: Option<PathBuf>,
    /// Folder for papers.md, papers.html and papers.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of Markdown
    #[arg(long)]
    json: bool,
}

impl Papers {
    pub fn run(&self) -> Result<(), StudyError> {
        make_folder(self.out.as_deref())?;
        let options = PapersOptions {
            // `none` is no GPU to measure on.
            gpu: self.gpu.clone().filter(|gpu| *gpu != GpuChoice::None),
            quick: self.quick,
            only_records: self.only_records,
            records: self.from.clone().or_else(records_of_checkout),
        };
        let progress = progress_bar(STEPS, "studies");
        let report = make(&options, || progress.inc(1))?;
        progress.finish_and_clear();
        let print = if self.json { Print::Json } else { Print::Text };
        deliver(&report, self.out.as_deref(), print)
    }
}

/// The records of the checkout that the command runs in.
fn records_of_checkout() -> Option<PathBuf> {
    let here = std::env::current_dir().ok()?;
    here.ancestors().map(|folder: &Path| folder.join(RECORDS)).find(|records| records.is_dir())
}
