//! Bounding spheres: the time of the all-pairs test, and the errors of plain f32.
//!
//! Source: N. Mohd Suaib, F. Mohd Nasir, "Broad phase collision detection using graphics processing
//! unit", 2015: all pairs of bounding spheres, sequential against parallel (table 1). The paper's
//! parallel version ran on a GPU; here it is the CPU's threads, and a GPU where one is asked for.
//!
//! The parts: [`oracle`] decides pairs in integers of any size; [`families`] makes pairs that are
//! hard to decide; `gpu` has a GPU decide and cull; `errors` counts the errors of ways to decide them; `speed`
//! times frames.

pub(crate) mod errors;
pub mod families;
pub(crate) mod gpu;
pub mod oracle;
pub(crate) mod speed;

use clap::Args;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport};

use super::harness::Report;
use super::harness::document::Part;
use super::harness::machine::Machine;
use super::harness::table::{Fields, row};
use super::papers::figure;
use crate::Result;

#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct SphereOptions {
    /// Count wrong decisions instead: of so many random pairs, a hundredth as many that touch, and
    /// as many that nearly do [default: 1000000]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "PAIRS", num_args = 0..=1, default_missing_value = "1000000")]
    pub errors: Option<u64>,
    /// Few spheres and few frames: a second, for a look. Times mean little
    #[arg(long)]
    pub quick: bool,
    /// Seed of scenes and pairs
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// Runs the study, on a GPU where one is named. `watch` is called with the number of further decided pairs, of
/// [`errors::pairs_decided`] in all.
pub(crate) fn measure(
    options: &SphereOptions,
    on: Option<&GpuChoice>,
    watch: impl Fn(u64) + Sync,
) -> Result<Report> {
    let SphereOptions { errors, quick, seed } = *options;
    let device = on.map(|choice| Gpu::open(choice, HostImport::IfPossible)).transpose()?;
    let [mut speed, mut on_cpu, mut gpu_speed, mut on_gpu] = <[Vec<Fields>; 4]>::default();
    match (&device, errors) {
        (None, None) => speed = speed::measure(quick, seed)?,
        (None, Some(pairs)) => on_cpu = errors::measure(pairs, seed, watch),
        (Some(device), None) => gpu_speed = gpu::measure(device, quick, seed)?,
        (Some(device), Some(pairs)) => on_gpu = gpu::count_errors(device, pairs, seed, watch)?,
    }
    let mut report = Report::new("spheres", vec![Part::heading(1, "Spheres")]);
    report.machine(&Machine::here(device.as_ref().map(|device| device.info())));
    let table_1 = "frames a second (Suaib et al. 2015, table 1)";
    report.section("speed", &format!("All pairs of spheres, {table_1}"), "", &speed);
    report.section("errors", "Wrong decisions, against exact arithmetic", "", &on_cpu);
    report.section("gpu_speed", &format!("Spheres on the GPU, {table_1}"), "", &gpu_speed);
    let decided = "Decided by the GPU, against exact arithmetic and the CPU";
    report.section("gpu_errors", decided, "", &on_gpu);
    Ok(report)
}

/// Whether every pair was decided rightly, by the client library and on the GPU.
pub(crate) fn is_exact(report: &Report) -> bool {
    let all = |list: &str, is_right: fn(&Fields) -> bool| report.lists[list].iter().all(is_right);
    all("errors", |row| row["exact_wrong"] == 0)
        && all("gpu_speed", |row| row["is_right"] == true)
        && all("gpu_errors", |row| row["wrong"] == 0 && row["beside_wrong"] == 0)
}

fn papers_row(n: usize) -> Fields {
    let of = |column: &str| figure(&format!("spheres[n={n}].{column}"));
    row!(
        paper_sequential_fps: of("sequential"),
        paper_parallel_fps: of("parallel"),
        paper_speed_up: of("speed_up"),
    )
}
