//! `threads`: speed-up by threads of the papers' two stages.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use crate::study::ways::Case;
use clap::Args;
use pairmaskd::cli::output::{make_folder, progress_bar};
use pairmaskd::cli::whole_number::whole_number;

use super::scenes::SceneSizes;
use crate::study::harness::{Print, StudyError, deliver};
use crate::study::threads::{SCENES, SIZES, STEPS_A_CASE, measure, papers_cases};

/// Speed-up by threads: updating boxes, and finding pairs with each CPU engine
#[derive(Debug, Args)]
#[command(after_help = "\
The two stages of Avril et al. 2009 and 2014: world boxes from transforms (n/c objects a thread), and
overlapping pairs (rows shared out, storage of its own for each thread). Thread counts take turns
frame by frame; the shortest frame counts, and speed-ups are over one thread. Beside them stands what
the 2014 paper gives in its Figures 5 to 9 for 1, 2, 4 and 8 cores of two Xeon X5482: 20,000 cubes,
10,000 balls and 3,500 skittles, all pairs compared.

Without --scene and --n: the paper's three scenes and sizes, and uniform, torus and letters of 10,000
and 100,000 boxes. An engine that would take many times the fastest is left out.

Examples:
  pairmask-lab threads
  pairmask-lab threads --threads 1,2,4,8 --scene cubes,balls --n 20000,1000000 --out speed-up")]
pub struct ThreadsBench {
    #[command(flatten)]
    what: SceneSizes,
    /// Numbers of threads [default: 1, 2, 4 … all cores]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N,..", value_delimiter = ',')]
    threads: Vec<NonZeroUsize>,
    /// Folder for threads.csv and threads.json
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print CSV instead of a table
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl ThreadsBench {
    pub fn run(&self) -> Result<(), StudyError> {
        make_folder(self.out.as_deref())?;
        let threads: Vec<usize> = self.threads.iter().map(|n| n.get()).collect();
        let cases = self.cases();
        let progress = progress_bar(STEPS_A_CASE * cases.len() as u64, "measuring");
        let report = measure(&cases, &threads, || progress.inc(1))?;
        progress.finish_and_clear();
        let print = match (self.json, self.csv) {
            (true, _) => Print::Json,
            (false, true) => Print::Csv,
            (false, false) => Print::Text,
        };
        deliver(&report, self.out.as_deref(), print)
    }

    fn cases(&self) -> Vec<Case> {
        let mut cases = self.what.cases(&SCENES, &SIZES);
        if self.what.is_default() {
            cases.splice(..0, papers_cases());
        }
        cases
    }
}
