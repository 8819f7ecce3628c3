//! The papers, complete: every table and figure of the four papers, theirs beside ours, what holds
//! and what breaks.
//!
//! `data/papers.toml` is the table of all that: figures of the papers, their tables and figures, and for each of
//! these its claims. A claim has a rule (`rule`) and rows: one for each element of `each` (a list, or the name of
//! one in `[lists]`), or for each row of a record's list that `all` selects, else one. `what` names the row,
//! `paper` is the paper's figure or an [`expression`] over `[figures]`, `ours` an expression over a record of the
//! kind `of`. `{x}` in texts is the element of `each`, `{name}` a field of it, of the selected row, or of the record.
//! `$name` is a text of `[text]`, `name(…)` an expression of `[define]`. What an item says but for its `label` and
//! `shows` holds for all its claims that do not say otherwise. `records` reads what earlier runs left,
//! [`page`] writes.
//!
//! A verdict is a rule's, never a hand's. A figure that nobody measured is `not measured`.

mod claims;
mod expression;
mod page;
mod records;
mod rule;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::Args;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::SceneName;

use self::claims::{Claim, Data, Kind};
use self::page::PapersReport;
use self::records::Figures;
use super::harness::{Fields, Report, machine_with, row};
use super::spheres::{self, SphereOptions};
use super::ways::Case;
use super::{grid, mapping, threads};
use crate::Result;

static DATA: LazyLock<Data> = LazyLock::new(|| {
    let read = toml::from_str(include_str!("../../../data/papers.toml"));
    // The file is part of this build, and tests read it.
    read.unwrap_or_else(|error| panic!("data/papers.toml: {error}"))
});

/// A figure of the papers: the value of an expression over `[figures]`, `None` where they have none.
pub fn figure(expression: &str) -> Option<f64> {
    DATA.paper_figure(expression).unwrap_or(None)
}

/// The claims that the mapping study judges by itself, a row each.
pub fn mapping_claims(report: &Report) -> Result<Vec<Fields>> {
    let mut figures = Figures::default();
    figures.add_run(Kind::Mapping, report)?;
    let mut found = Vec::new();
    for entry in &DATA.mapping {
        for Claim { says, rule, verdict, why, .. } in DATA.judge(entry, &figures)? {
            let evidence = if why.is_empty() { rule } else { format!("{rule}: {why}") };
            found.push(row!(label: entry.label, claim: says, verdict, evidence));
        }
    }
    Ok(found)
}

#[derive(Clone, Debug, Default, Args)]
pub struct PapersOptions {
    /// The GPU to measure on: auto, software, a number of `pairmaskd status`, or part of a name
    /// [default: none, GPU figures are those of records]
    #[arg(long, value_name = "GPU")]
    gpu: Option<GpuChoice>,
    /// Small sizes and few runs: seconds, for a look. Times mean little
    #[arg(long)]
    quick: bool,
    /// Measure nothing
    #[arg(long, conflicts_with_all = ["gpu", "quick"])]
    only_records: bool,
    /// Folder of the folders of records [default: tests/records of the checkout, where it is there]
    #[arg(long, value_name = "DIR")]
    from: Option<PathBuf>,
}

/// Measures, reads the records, and judges. `watch` is called [`STEPS`] times where it measures.
pub fn make(options: &PapersOptions, watch: impl Fn()) -> Result<PapersReport> {
    let here = std::env::current_dir().unwrap_or_default();
    let mut of_checkout = here.ancestors().map(|folder: &Path| folder.join("tests/records"));
    let of_checkout = || of_checkout.find(|records| records.is_dir());
    let records = options.from.clone().or_else(of_checkout);
    let mut figures = Figures::read(records.as_deref())?;
    if !options.only_records {
        measure(&mut figures, options, watch)?;
    }
    figures.join();
    PapersReport::of(machine_with(None), options.only_records, &figures)
}

/// Calls of the watcher: one a study.
pub const STEPS: u64 = 4;
/// Boxes of the grid study: the papers' sizes.
const GRID_COUNTS: [u32; 5] = [1_000, 10_000, 20_000, 100_000, 1_000_000];
/// Boxes of the 2009 paper, in place of its cubes.
const CASE_2009: Case = Case { scene: SceneName::Uniform, n: 100_000 };

fn measure(figures: &mut Figures, options: &PapersOptions, watch: impl Fn()) -> Result<()> {
    // `none` is no GPU to measure on.
    let gpu = options.gpu.as_ref().filter(|gpu| **gpu != GpuChoice::None);
    let quick = options.quick;
    figures.add_run(Kind::Mapping, &mapping::measure(gpu.unwrap_or(&GpuChoice::None), quick)?)?;
    watch();
    if let Some(gpu) = gpu {
        let counts = if quick { &GRID_COUNTS[..1] } else { &GRID_COUNTS };
        figures.add_run(Kind::Grid, &grid::measure(gpu, counts, quick)?)?;
    }
    watch();
    // Seconds on two cores.
    let pairs = if quick { 10_000 } else { 1_000_000 };
    let errors = SphereOptions { errors: Some(pairs), quick, seed: 1 };
    let mut report = spheres::measure(&errors, None, |_| ())?;
    if let Some(gpu) = gpu {
        let speed = SphereOptions { errors: None, ..errors };
        let on_gpu = spheres::measure(&speed, Some(gpu), |_| ())?;
        report.values = on_gpu.values;
        report.list("gpu_speed", &on_gpu.lists["gpu_speed"]);
    }
    figures.add_run(Kind::Spheres, &report)?;
    watch();
    let mut cases: Vec<Case> = threads::papers_cases().collect();
    if quick {
        cases.sort_unstable_by_key(|case| case.n);
        cases.truncate(1);
    } else {
        cases.push(CASE_2009);
    }
    figures.add_run(Kind::Threads, &threads::measure(&cases, &[], || ())?)?;
    watch();
    Ok(())
}
