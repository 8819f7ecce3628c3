//! `spheres`: all pairs of spheres, and what plain f32 gets wrong.

use clap::Args;
use pairmaskd::cli::output::{progress_bar, spinner};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::GpuChoice;

use crate::study::harness::{Print, StudyError, deliver};
use crate::study::spheres::errors::pairs_decided;
use crate::study::spheres::{SphereOptions, measure, measure_on_gpu};

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
    /// Count wrong decisions instead: of so many random pairs, a hundredth as many that touch, and
    /// as many that nearly do [default: 1000000]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "PAIRS", num_args = 0..=1, default_missing_value = "1000000")]
    errors: Option<u64>,
    /// The GPU to measure instead: auto, software, a number of `pairmaskd status`, or part of a name
    #[arg(long, value_name = "GPU")]
    gpu: Option<GpuChoice>,
    /// Few spheres and few frames: a second, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Seed of scenes and pairs
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Spheres {
    pub fn run(&self) -> Result<(), StudyError> {
        let options = SphereOptions {
            speed: self.errors.is_none(),
            pairs: self.errors.unwrap_or(0),
            quick: self.quick,
            seed: self.seed,
        };
        let progress = match self.errors {
            Some(pairs) => progress_bar(pairs_decided(pairs), "pairs of spheres"),
            None => spinner("spheres"),
        };
        let watch = |pairs| progress.inc(pairs);
        let report = match &self.gpu {
            Some(gpu) => measure_on_gpu(&options, gpu, watch)?,
            None => measure(&options, watch),
        };
        progress.finish_and_clear();
        let print = if self.json { Print::Json } else { Print::Text };
        deliver(&report, None, print)?;
        if report.is_exact() { Ok(()) } else { Err(StudyError::InexactSpheres) }
    }
}
