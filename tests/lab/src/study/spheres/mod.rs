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
use gpu::GpuErrorRow;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport};
use serde::Serialize;

use super::harness::StudyReport;
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
) -> Result<SphereReport> {
    let SphereOptions { errors, quick, seed } = *options;
    let device = on.map(|choice| Gpu::open(choice, HostImport::IfPossible)).transpose()?;
    let machine = Machine::here(device.as_ref().map(|device| device.info()));
    let mut report = SphereReport { machine, ..SphereReport::default() };
    match (&device, errors) {
        (None, None) => report.speed = speed::measure(quick, seed),
        (None, Some(pairs)) => report.errors = errors::measure(pairs, seed, watch),
        (Some(device), None) => report.gpu_speed = gpu::measure(device, quick, seed)?,
        (Some(device), Some(pairs)) => {
            report.gpu_errors = gpu::count_errors(device, pairs, seed, watch)?;
        }
    }
    Ok(report)
}

fn papers_row(n: usize) -> Fields {
    let of = |column: &str| figure(&format!("spheres[n={n}].{column}"));
    row!(
        paper_sequential_fps: of("sequential"),
        paper_parallel_fps: of("parallel"),
        paper_speed_up: of("speed_up"),
    )
}

/// The JSON object of `spheres --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct SphereReport {
    pub machine: Machine,
    pub speed: Vec<Fields>,
    pub errors: Vec<Fields>,
    pub gpu_speed: Vec<Fields>,
    pub gpu_errors: Vec<GpuErrorRow>,
}

impl SphereReport {
    /// Whether every pair was decided rightly, by the client library and on the GPU.
    pub fn is_exact(&self) -> bool {
        self.errors.iter().all(|row| row["exact_wrong"] == 0)
            && self.gpu_speed.iter().all(|row| row["is_right"] == true)
            && self.gpu_errors.iter().all(|row| row.wrong + row.beside_wrong == 0)
    }
}

impl StudyReport for SphereReport {
    const NAME: &'static str = "spheres";

    fn parts(&self) -> Vec<Part> {
        let mut parts = vec![Part::heading(1, "Spheres")];
        parts.extend(self.machine.parts());
        let table_1 = "frames a second (Suaib et al. 2015, table 1)";
        let on_cpu = format!("All pairs of spheres, {table_1}");
        parts.extend(Part::section(&on_cpu, "", &self.speed));
        parts.extend(Part::section("Wrong decisions, against exact arithmetic", "", &self.errors));
        let on_gpu = format!("Spheres on the GPU, {table_1}");
        parts.extend(Part::section(&on_gpu, "", &self.gpu_speed));
        let decided = "Decided by the GPU, against exact arithmetic and the CPU";
        parts.extend(Part::section(decided, "", &self.gpu_errors));
        parts
    }
}
