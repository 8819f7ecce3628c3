//! Bounding spheres: the time of the all-pairs test, and the errors of plain f32.
//!
//! Source: N. Mohd Suaib, F. Mohd Nasir, "Broad phase collision detection using graphics processing
//! unit", 2015: all pairs of bounding spheres, sequential against parallel (table 1). The paper's
//! parallel version ran on a GPU; here it is the CPU's threads, and a GPU where one is asked for.

pub(crate) mod errors;
pub mod families;
pub mod oracle;
pub(crate) mod speed;

use clap::Args;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport};

use super::harness::{Fields, Part, Report, machine_with};
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
        (None, None) => speed = speed::measure(None, quick, seed)?,
        (None, Some(pairs)) => on_cpu = errors::measure(pairs, seed, watch),
        (Some(device), None) => gpu_speed = speed::measure(Some(device), quick, seed)?,
        (Some(device), Some(pairs)) => on_gpu = errors::on_gpu(device, pairs, seed, watch)?,
    }
    let mut report = Report::new("spheres", vec![Part::heading(1, "Spheres")]);
    report.machine(machine_with(device.as_ref().map(|device| device.info())));
    let table_1 = "frames a second (Suaib et al. 2015, table 1)";
    report.section("speed", &format!("All pairs of spheres, {table_1}"), "", &speed);
    report.section("errors", "Wrong decisions, against exact arithmetic", "", &on_cpu);
    report.section("gpu_speed", &format!("Spheres on the GPU, {table_1}"), "", &gpu_speed);
    let decided = "Decided by the GPU, against exact arithmetic and the CPU";
    report.section("gpu_errors", decided, "", &on_gpu);
    // Every pair was decided rightly, by the client library and on the GPU.
    let is_exact = on_cpu.iter().all(|row| row["exact_wrong"] == 0)
        && gpu_speed.iter().all(|row| row["is_right"] == true)
        && on_gpu.iter().all(|row| row["wrong"] == 0 && row["beside_wrong"] == 0);
    let fault = "pairs of spheres were decided wrongly: please report this";
    report.fault = (!is_exact).then_some(fault);
    Ok(report)
}
