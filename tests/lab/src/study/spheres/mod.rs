//! Bounding spheres: the time of the all-pairs test, and the errors of plain f32.
//!
//! Source: N. Mohd Suaib, F. Mohd Nasir, "Broad phase collision detection using graphics processing
//! unit", 2015: all pairs of bounding spheres, sequential against parallel (table 1). The paper's
//! parallel version ran on a GPU; here it is the CPU's threads, and a GPU where one is asked for.
//!
//! The parts: [`oracle`] decides pairs in integers of any size; [`families`] makes pairs that are
//! hard to decide; [`gpu`] has a GPU decide and cull; [`errors`] counts the errors of ways to decide them; [`speed`] times frames;
//! [`paper`] holds the paper's table; [`report`] writes all of it down.

pub mod errors;
pub mod families;
pub mod gpu;
pub mod oracle;
pub mod paper;
pub mod report;
pub mod speed;

pub use errors::{ErrorRow, count_errors};
pub use report::SphereReport;

use pairmaskd::execute::gpu::GpuChoice;

use super::machine::Machine;
use crate::gpu_stages::BenchError;

/// Options of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SphereOptions {
    /// Time frames.
    pub speed: bool,
    /// Count errors on so many random pairs, and a hundredth of them tangent; 0 for none.
    pub pairs: u64,
    /// Few spheres and few runs, in seconds. Times mean little.
    pub quick: bool,
    /// Seed of scenes and pairs.
    pub seed: u64,
}

/// The same on a GPU. `watch` as in [`measure`].
///
/// # Errors
/// [`BenchError`].
pub fn measure_on_gpu(
    options: &SphereOptions,
    choice: &GpuChoice,
    watch: impl Fn(u64) + Sync,
) -> Result<SphereReport, BenchError> {
    let device = gpu::open(choice)?;
    let mut report = SphereReport {
        machine: Machine::here(Some(device.info())),
        speed: Vec::new(),
        errors: Vec::new(),
        gpu_speed: Vec::new(),
        gpu_errors: Vec::new(),
    };
    if options.speed {
        report.gpu_speed = gpu::measure(&device, options.quick, options.seed)?;
    }
    if options.pairs > 0 {
        report.gpu_errors = gpu::count_errors(&device, options.pairs, options.seed, watch)?;
    }
    Ok(report)
}

/// Runs the study. `watch` is called with the number of further decided pairs, of
/// [`errors::pairs_decided`] in all.
pub fn measure(options: &SphereOptions, watch: impl Fn(u64) + Sync) -> SphereReport {
    let speed =
        if options.speed { speed::measure(options.quick, options.seed) } else { Vec::new() };
    let errors = if options.pairs > 0 {
        errors::measure(options.pairs, options.seed, watch)
    } else {
        Vec::new()
    };
    SphereReport {
        machine: Machine::here(None),
        speed,
        errors,
        gpu_speed: Vec::new(),
        gpu_errors: Vec::new(),
    }
}
