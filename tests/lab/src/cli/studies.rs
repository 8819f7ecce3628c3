//! The commands of studies: what is measured, and what becomes of the results.

use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use pairmaskd::cli::options::{CommonOptions, DaemonOptions};
use pairmaskd::cli::output::{make_folder, print_json, print_text};
use pairmaskd::cli::progress::{progress_bar, spinner};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport, OpenError};
use pairmaskd::scene::SceneName;

use crate::Result;
use crate::gpu_stages::scenes::{Case as SceneCase, Effort, measure as measure_scene};
use crate::study::harness::{Part, Report, Table, markdown};
use crate::study::moving::{Motion, World};
use crate::study::papers::{PapersOptions, STEPS, make};
use crate::study::spheres::errors::pairs_decided;
use crate::study::spheres::{self, SphereOptions};
use crate::study::ways::Case;
use crate::study::{advice, grid, judge, mapping, threads};

/// A command that measures: what it gives its report for.
pub trait Study: Args {
    fn measure(&self, common: &CommonOptions) -> Result<Report>;
}

#[derive(Debug, Args)]
pub struct Measured<S: Args> {
    #[command(flatten)]
    study: S,
    /// Folder for the results as files
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV
    #[arg(long)]
    csv: bool,
}

impl<S: Study> Measured<S> {
    /// Measures, writes the files and prints. The folder is made first, so that a wrong name fails at once.
    pub fn run(&self, common: &CommonOptions) -> Result<()> {
        make_folder(self.out.as_deref())?;
        let report = self.study.measure(common)?;
        if let Some(folder) = &self.out {
            report.write(folder)?;
        }
        if self.json {
            print_json(&report)?;
        } else if self.csv {
            print_text(report.csv().trim_end())?;
        } else {
            print_text(markdown(&report.parts).trim_end())?;
        }
        report.fault.map_or(Ok(()), |fault| Err(fault.into()))
    }
}

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
}

impl Study for Mapping {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let _spinner = spinner("measuring");
        mapping::measure(&self.options.gpu(common), self.quick)
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
    options: DaemonOptions,
    /// Small sizes and few runs: seconds, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Numbers of boxes
    #[arg(long, conflicts_with = "quick", value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 1_000_000])]
    n: Vec<u32>,
}

impl Study for Grid {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let _spinner = spinner("measuring");
        let counts = if self.quick { &[1_000][..] } else { &self.n };
        grid::measure(&self.options.gpu(common), counts, self.quick)
    }
}

/// Persistent scenes in video memory: what an edit and its changes cost, by how much moves
#[derive(Debug, Args)]
#[command(after_help = "\
Times are µs: edit in, sorted changes out (median and 99 of 100). What was reported is compared with a fresh
search on the CPU at the end of each line. Between edits there are queries: their whole time (1, 50 and
99 of 100). Needs a GPU; no daemon is between. Several GPUs (--gpu 0,1) keep each scene together;
times of stages are those of the first.

Examples:
  pairmask-lab gpu-scene --n 1000000 --moving 1,10,100 --stages
  pairmask-lab gpu-scene --gpu 0,1 --n 10000000 --moving 10 --queries 0
  pairmask-lab gpu-scene --gpu software --n 1000 --frames 5")]
pub struct GpuSceneBench {
    #[command(flatten)]
    options: DaemonOptions,
    /// Numbers of boxes
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [100_000, 1_000_000])]
    n: Vec<u32>,
    /// Scenes, as `pairmaskd scene` names them
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = [SceneName::Uniform, SceneName::Pile])]
    scene: Vec<SceneName>,
    /// How many of a hundred boxes move in each edit
    #[arg(long, value_parser = percent, value_name = "PERCENT,..", value_delimiter = ',', default_values_t = [0.0, 0.01, 0.1, 1.0, 10.0, 100.0])]
    moving: Vec<f64>,
    /// How they move: drift, jitter, teleport, spawn
    #[arg(long, value_name = "MOTION,..", value_delimiter = ',', default_value = "drift")]
    motion: Vec<Motion>,
    #[command(flatten)]
    effort: Effort,
}

fn percent(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok().filter(|percent| (0.0..=100.0).contains(percent));
    percent.ok_or_else(|| "must be a number from 0 to 100, such as 0.1".to_owned())
}

impl Study for GpuSceneBench {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let choices = self.options.gpus(common).each();
        let gpus = choices.iter().map(|gpu| Gpu::open(gpu, HostImport::IfPossible));
        let gpus = gpus.collect::<Result<Vec<_>, _>>()?;
        if gpus.is_empty() {
            return Err(OpenError::SwitchedOff.into());
        }
        let _spinner = spinner("measuring");
        let worlds = self.scene.iter().flat_map(|scene| self.n.iter().map(|n| (*scene, *n)));
        let worlds = worlds.flat_map(|(scene, n)| self.motion.iter().map(move |m| (scene, n, *m)));
        let mut rows = Vec::new();
        for (scene, n, motion) in worlds {
            let mut world = World::new(scene, n as usize);
            for &percent in &self.moving {
                let case = SceneCase { scene, motion, percent, effort: self.effort };
                rows.push(measure_scene(&gpus, &mut world, &case)?);
            }
        }
        let names: Vec<_> = gpus.iter().map(|gpu| gpu.info().name.clone()).collect();
        let mut report = Report::new("gpu-scene", vec![Part::text(names.join(", "))]);
        report.parts.push(Part::Table(Table::of(&rows)));
        report.value("gpus", names);
        report.list("rows", &rows);
        Ok(report)
    }
}

#[derive(Debug, Args)]
struct Cases {
    /// Scenes, as `pairmaskd scene` names them [default: see below]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    scene: Vec<SceneName>,
    /// Numbers of boxes [default: see below]
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',')]
    n: Vec<u32>,
    /// Numbers of threads [default: see below]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N,..", value_delimiter = ',')]
    threads: Vec<NonZeroUsize>,
}

impl Cases {
    /// Most pairs of a scene where all boxes overlap: larger ones are left out.
    const MOST_QUADRATIC_PAIRS: u64 = 10_000_000;

    /// Every scene in every size; quadratic ones up to [`Self::MOST_QUADRATIC_PAIRS`].
    fn of(&self, scenes: &[SceneName], sizes: &[u32]) -> Vec<Case> {
        let scenes = if self.scene.is_empty() { scenes } else { &self.scene };
        let sizes = if self.n.is_empty() { sizes } else { &self.n };
        let sizes = |scene| sizes.iter().map(move |n| Case { scene, n: *n as usize });
        let pairs = |case: &Case| pairmask_core::BoxCount::new(case.n as u32).pair_count();
        let is_few =
            |case: &Case| !case.scene.is_quadratic() || pairs(case) <= Self::MOST_QUADRATIC_PAIRS;
        scenes.iter().flat_map(|scene| sizes(*scene)).filter(is_few).collect()
    }

    fn threads(&self) -> Vec<usize> {
        self.threads.iter().map(|n| n.get()).collect()
    }
}

/// The planned engine beside the best one
#[derive(Debug, Args)]
#[command(after_help = "\
All CPU engines cull the same moving boxes, interleaved, in process. The ratio is the time of what is
planned, after 50 frames to learn from, over that of the fastest engine, encoding and number of threads.
Frames count from boxes in place (for what is planned, from its planning) to the last pair decoded; the
shortest one counts. Rows above 1.15 and 1.4 are counted. Without arguments it takes minutes: all scenes whose pairs do not grow with the square of n, 64
to a million boxes; the plan may use 1 thread, and all cores.

Examples:
  pairmask-lab plan --scene uniform,rods --n 64,1000,4096
  pairmask-lab plan --json")]
pub struct PlanBench {
    #[command(flatten)]
    cases: Cases,
}

impl Study for PlanBench {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let not_quadratic = SceneName::ALL.into_iter().filter(|scene| !scene.is_quadratic());
        let cases = self.cases.of(&not_quadratic.collect::<Vec<_>>(), &judge::SIZES);
        let progress = progress_bar(cases.len() as u64, "measuring");
        judge::measure(&cases, &self.cases.threads(), common.isa(), || progress.inc(1))
    }
}

/// What `pairmaskd advise` advises, beside the fastest of all ways
#[derive(Debug, Args)]
#[command(after_help = "\
For each recording of a folder: the advice, then all ways that could be advised, measured afresh and in turns. The
ratio is the time of a tick with the advised way over that with the fastest one; both are of the second
measurement. Ways whose pairs may be near count where the recorded program sends narrow boxes. The exit status
is 1 where a ratio is above 1.15. It needs no other program than this one.

Examples:
  pairmask-lab advice
  pairmask-lab advice recordings --gpu none --out advice
  pairmask-lab advice --seconds 60 --json")]
pub struct AdviceBench {
    /// Folder of recordings (.pmrec)
    #[arg(value_name = "DIR", default_value = "tests/recordings")]
    folder: PathBuf,
    #[command(flatten)]
    options: DaemonOptions,
    /// How long each recording takes, half of it for the advice
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "40")]
    seconds: NonZeroU64,
}

impl Study for AdviceBench {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let files = advice::recordings(&self.folder)?;
        let progress = progress_bar(files.len() as u64, "measuring");
        let half = Duration::from_secs(self.seconds.get()) / 2;
        let times = advice::Times { advice: half, all: half };
        advice::measure(&files, self.options.private(common), times, || progress.inc(1))
    }
}

/// Speed-up by threads: updating boxes, and finding pairs with each CPU engine
#[derive(Debug, Args)]
#[command(after_help = "\
The two stages of Avril et al. 2009 and 2014: world boxes from transforms (n/c objects a thread), and
overlapping pairs (rows shared out, storage of its own for each thread). Thread counts take turns
frame by frame; the shortest frame counts, and speed-ups are over one thread. Beside them stands what
the 2014 paper gives in its Figures 5 to 9 for 1, 2, 4 and 8 cores of two Xeon X5482: 20,000 cubes,
10,000 balls and 3,500 skittles, all pairs compared.

Without --scene and --n: the paper's three scenes and sizes, and uniform, torus and letters of 10,000
and 100,000 boxes. Without --threads: 1, 2, 4 … all cores. An engine that would take many times the fastest
is left out.

Examples:
  pairmask-lab threads
  pairmask-lab threads --threads 1,2,4,8 --scene cubes,balls --n 20000,1000000 --out speed-up")]
pub struct ThreadsBench {
    #[command(flatten)]
    cases: Cases,
}

impl Study for ThreadsBench {
    fn measure(&self, _: &CommonOptions) -> Result<Report> {
        let mut cases = self.cases.of(&threads::SCENES, &threads::SIZES);
        if self.cases.scene.is_empty() && self.cases.n.is_empty() {
            cases.splice(..0, threads::papers_cases());
        }
        let progress = progress_bar(cases.len() as u64, "measuring");
        threads::measure(&cases, &self.cases.threads(), || progress.inc(1))
    }
}

/// All pairs of bounding spheres, sequential against parallel, beside the paper's (Suaib 2015)
#[derive(Debug, Args)]
#[command(after_help = "\
Columns: one pair after the other in plain f32; all pairs, exact, on one thread and on all; what
the sphere engines choose; the paper's table 1. With --errors what plain f32 decides wrongly, against
exact arithmetic: random pairs, near ties, and pairs that touch by construction (Pythagorean
quadruples, scaled).

Examples:
  pairmask-lab spheres
  pairmask-lab spheres --errors
  pairmask-lab spheres --errors 100000000     half a minute on two cores
  pairmask-lab spheres --gpu auto             on a GPU, to a million spheres
  pairmask-lab spheres --gpu auto --errors    what a GPU decides wrongly: nothing

Exit status: 1 where the library itself decided a pair wrongly.")]
pub struct Spheres {
    #[command(flatten)]
    options: SphereOptions,
    /// The GPU to measure instead: auto, software, a number of `pairmaskd status`, or part of a name
    #[arg(long, value_name = "GPU")]
    gpu: Option<GpuChoice>,
}

impl Study for Spheres {
    fn measure(&self, _: &CommonOptions) -> Result<Report> {
        let progress = match self.options.errors {
            Some(pairs) => progress_bar(pairs_decided(pairs), "pairs of spheres"),
            None => spinner("spheres"),
        };
        spheres::measure(&self.options, self.gpu.as_ref(), |pairs| progress.inc(pairs))
    }
}

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
    #[command(flatten)]
    options: PapersOptions,
}

impl Study for Papers {
    fn measure(&self, _: &CommonOptions) -> Result<Report> {
        let progress = progress_bar(STEPS, "studies");
        make(&self.options, || progress.inc(1)).map(|page| page.report())
    }
}
