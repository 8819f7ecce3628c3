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

use errors::ErrorRow;
use gpu::GpuErrorRow;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport};
use serde::Serialize;

use super::harness::Report;
use super::harness::document::Part;
use super::harness::machine::Machine;
use super::harness::table::Fields;
use super::papers::figure;
use crate::Result;

/// Options of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SphereOptions {
    pub speed: bool,
    /// Count errors on so many random pairs, and a hundredth of them tangent; 0 for none.
    pub pairs: u64,
    /// Few spheres and few runs, in seconds. Times mean little.
    pub quick: bool,
    pub seed: u64,
}

/// Runs the study, on a GPU where one is named. `watch` is called with the number of further decided pairs, of
/// [`errors::pairs_decided`] in all.
pub(crate) fn measure(
    options: &SphereOptions,
    on: Option<&GpuChoice>,
    watch: impl Fn(u64) + Sync,
) -> Result<SphereReport> {
    let SphereOptions { speed, pairs, quick, seed } = *options;
    let device = on.map(|choice| Gpu::open(choice, HostImport::IfPossible)).transpose()?;
    let machine = Machine::here(device.as_ref().map(|device| device.info()));
    let (speed_rows, errors, gpu_speed, gpu_errors) = Default::default();
    let mut report = SphereReport { machine, speed: speed_rows, errors, gpu_speed, gpu_errors };
    match &device {
        Some(device) if speed => report.gpu_speed = gpu::measure(device, quick, seed)?,
        None if speed => report.speed = speed::measure(quick, seed),
        _ => {}
    }
    match &device {
        Some(device) if pairs > 0 => {
            report.gpu_errors = gpu::count_errors(device, pairs, seed, watch)?;
        }
        None if pairs > 0 => report.errors = errors::measure(pairs, seed, watch),
        _ => {}
    }
    Ok(report)
}

/// The paper's row for so many spheres: frames a second of the sequential and the parallel approach, speed-up.
fn papers_row(n: usize) -> [Option<f64>; 3] {
    ["sequential", "parallel", "speed_up"].map(|column| figure(&format!("spheres[n={n}].{column}")))
}

/// The JSON object of `spheres --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SphereReport {
    pub machine: Machine,
    pub speed: Vec<Fields>,
    pub errors: Vec<ErrorRow>,
    pub gpu_speed: Vec<Fields>,
    pub gpu_errors: Vec<GpuErrorRow>,
}

impl SphereReport {
    /// Whether every pair was decided rightly, by the client library and on the GPU.
    pub fn is_exact(&self) -> bool {
        self.errors.iter().all(|row| row.exact_wrong == 0)
            && self.gpu_speed.iter().all(|row| row["is_right"] == true)
            && self.gpu_errors.iter().all(|row| row.wrong + row.beside_wrong == 0)
    }
}

impl Report for SphereReport {
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
