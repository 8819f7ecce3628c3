//! The figures of this run.

use crate::study::ways::Case;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::SceneName;

use super::PapersOptions;
use super::claims::Kind;
use super::records::Figures;
use crate::study::harness::StudyError;
use crate::study::spheres::{self, SphereOptions};
use crate::study::{grid, mapping, threads};

/// Calls of the watcher: one a study.
pub const STEPS: u64 = 4;
/// Boxes of the grid study: the papers' sizes.
const GRID_COUNTS: [u32; 5] = [1_000, 10_000, 20_000, 100_000, 1_000_000];
/// Boxes of the 2009 paper, in place of its cubes.
const CASE_2009: Case = Case { scene: SceneName::Uniform, n: 100_000 };
/// Pairs of spheres that are decided: seconds on two cores.
const SPHERE_PAIRS: u64 = 1_000_000;
const QUICK_SPHERE_PAIRS: u64 = 10_000;
const SEED: u64 = 1;

/// Runs the studies and puts their figures before those of records.
pub fn into(
    figures: &mut Figures,
    options: &PapersOptions,
    watch: impl Fn(),
) -> Result<(), StudyError> {
    let PapersOptions { gpu, quick, .. } = options;
    let none = GpuChoice::None;
    figures.add_run(Kind::Mapping, &mapping::measure(gpu.as_ref().unwrap_or(&none), *quick)?)?;
    watch();
    if let Some(gpu) = gpu {
        let counts = if *quick { &GRID_COUNTS[..1] } else { &GRID_COUNTS };
        figures.add_run(Kind::Grid, &grid::measure(gpu, counts, *quick)?)?;
    }
    watch();
    let pairs = if *quick { QUICK_SPHERE_PAIRS } else { SPHERE_PAIRS };
    let errors = SphereOptions { speed: false, pairs, quick: *quick, seed: SEED };
    let mut report = spheres::measure(&errors, |_| ());
    if let Some(gpu) = gpu {
        let speed = SphereOptions { speed: true, pairs: 0, ..errors };
        let on_gpu = spheres::measure_on_gpu(&speed, gpu, |_| ())?;
        report.machine = on_gpu.machine;
        report.gpu_speed = on_gpu.gpu_speed;
    }
    figures.add_run(Kind::Spheres, &report)?;
    watch();
    let mut cases: Vec<Case> = threads::papers_cases().collect();
    if *quick {
        cases.sort_unstable_by_key(|case| case.n);
        cases.truncate(1);
    } else {
        cases.push(CASE_2009);
    }
    figures.add_run(Kind::Threads, &threads::measure(&cases, &[], || ())?)?;
    watch();
    Ok(())
}
