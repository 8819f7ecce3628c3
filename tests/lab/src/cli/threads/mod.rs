//! `threads`: speed-up by threads of the papers' two stages.

mod paper;
mod report;

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use pairmask_core::EngineName;
use pairmask_core::engine::AvailableIsa;
use pairmaskd::calibrate::{
    Case, CaseTimes, Effort, Pools, WaySet, core_count, measure, thread_counts,
};
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::output::{make_folder, print_json, print_text, progress_bar};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::scene::SceneName;

use self::report::{Stage, ThreadsReport, ThreadsRow};
use crate::cli::error::LabError;
use crate::cli::scenes::SceneSizes;
use crate::study::updates::update_times;

/// Default sizes beside the paper's own.
const SIZES: [u32; 2] = [10_000, 100_000];
/// Scenes of those sizes.
const SCENES: [SceneName; 3] = [SceneName::Uniform, SceneName::Torus, SceneName::Letters];
const EFFORT: Effort =
    Effort { least_frames: 7, most_frames: 200, time: Duration::from_millis(400) };

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
    pub fn run(&self) -> Result<(), LabError> {
        make_folder(self.out.as_deref())?;
        let machine = Machine::this();
        let mut threads: Vec<usize> = self.threads.iter().map(|n| n.get()).collect();
        if threads.is_empty() {
            threads = thread_counts(core_count());
        }
        // Speed-ups are over one thread.
        threads.push(1);
        threads.sort_unstable();
        threads.dedup();
        let pools = Pools::new(&threads)?;
        let cases = self.cases();
        let progress = progress_bar(2 * cases.len() as u64, "measuring");
        let (mut rows, isa) = (Vec::new(), AvailableIsa::best());
        for case in cases {
            let updates = update_times(case.scene, case.n, &threads, &pools, &EFFORT)?;
            rows.extend(ThreadsRow::series(Stage::UpdateAabbs, case, None, updates));
            progress.inc(1);
            let measured = measure(case, WaySet::Sparse, &threads, &pools, &EFFORT, isa)?;
            rows.extend(pair_rows(&measured));
            progress.inc(1);
        }
        progress.finish_and_clear();
        let report = ThreadsReport { machine, rows };
        if let Some(folder) = &self.out {
            report.write_files(folder)?;
        }
        if self.json {
            print_json(&report)
        } else if self.csv {
            print_text(report.csv().trim_end())
        } else {
            print_text(&report.to_string())
        }?;
        Ok(())
    }

    fn cases(&self) -> Vec<Case> {
        let mut cases = self.what.cases(&SCENES, &SIZES);
        if self.what.is_default() {
            let papers = paper::SCENES.iter().map(|p| Case { scene: p.scene, n: p.n });
            cases.splice(..0, papers);
        }
        cases
    }
}

/// Rows of the second stage: one for every engine and number of threads.
fn pair_rows(measured: &CaseTimes) -> Vec<ThreadsRow> {
    let mut rows = Vec::new();
    for engine in EngineName::ALL {
        let ways = measured.ways.iter().filter(|(way, _)| way.engine == engine);
        let series: Vec<_> =
            ways.map(|(way, times)| (way.threads, times.engine_ns.clone())).collect();
        rows.extend(ThreadsRow::series(
            Stage::OverlappingPairs,
            measured.case,
            Some(engine),
            series,
        ));
    }
    rows
}
