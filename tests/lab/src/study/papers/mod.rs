//! The papers, complete: every table and figure of the four papers, theirs beside ours, what holds
//! and what breaks.
//!
//! `data/papers.toml` is the table of all that: figures of the papers, their tables and figures, and for each of
//! these its claims. A claim has a rule (`rule`) and rows: one for each element of `each` (a list, or the name of
//! one in `[lists]`), or for each row of a record's list that `all` selects, else one. `what` names the row,
//! `paper` is the paper's figure or an [`expression`] over `[figures]`, `ours` an expression over a record of the
//! kind `of`. `{x}` in texts is the element of `each`, `{name}` a field of it, of the selected row, or of the record.
//! `$name` is a text of `[text]`, `name(…)` an expression of `[define]`. What an item says but for its `place` and
//! `shows` holds for all its claims that do not say otherwise. `records` reads what earlier runs left, `measure`
//! runs the studies, [`page`] writes.
//!
//! A verdict is a rule's, never a hand's. A figure that nobody measured is `not measured`.

mod claims;
pub mod expression;
mod measure;
pub mod page;
mod records;
mod rule;
mod several_gpus;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::LazyLock;

use pairmaskd::execute::gpu::GpuChoice;
use serde_json::Value;

pub use self::claims::{Claim, Item, Row};
use self::claims::{ClaimSource, Data};
pub use self::measure::STEPS;
pub use self::page::PapersReport;
use self::records::Figures;
pub use self::rule::Verdict;
use super::harness::StudyError;
use super::harness::machine::Machine;

/// The table of claims.
static DATA: LazyLock<Data> = LazyLock::new(|| {
    let read = toml::from_str(include_str!("../../../data/papers.toml"));
    // The file is part of this build, and tests read it.
    read.unwrap_or_else(|error| panic!("data/papers.toml: {error}"))
});

/// A figure of the papers: the value of an expression over `[figures]`, `None` where they have none.
///
/// ```
/// use pairmask_lab::study::papers::figure;
/// assert_eq!(figure("table_2[n=1000].own"), Some(0.21));
/// assert_eq!(figure("table_2[n=7].own"), None);
/// ```
pub fn figure(expression: &str) -> Option<f64> {
    DATA.paper_figure(expression).unwrap_or(None)
}

/// Other authors' lines beside ours over the number of boxes: name, and (boxes, ns).
pub fn lines() -> impl Iterator<Item = (&'static str, &'static [(f64, f64)])> {
    DATA.line.iter().map(|line| (line.name.as_str(), line.points.as_slice()))
}

/// The claims that the mapping study judges by itself: place, and claim.
///
/// # Errors
/// [`StudyError::Claims`].
pub fn mapping_claims(report: &Value) -> Result<Vec<(String, Claim)>, StudyError> {
    let source = ClaimSource { from: "this run".to_owned(), data: report };
    let mut found = Vec::new();
    for item in &DATA.mapping {
        for claim in DATA.judge(item, |_, _| vec![source.clone()], |_| String::new())?.claims {
            found.push((item.place.clone(), claim));
        }
    }
    Ok(found)
}

/// Options of the page.
#[derive(Clone, Debug, Default)]
pub struct PapersOptions {
    /// The GPU; without one the CPU alone is measured.
    pub gpu: Option<GpuChoice>,
    /// Small sizes and few runs. Times mean little.
    pub quick: bool,
    /// Measure nothing.
    pub only_records: bool,
    /// The folder of records; without one there are none.
    pub records: Option<PathBuf>,
}

/// Measures, reads the records, and judges. `watch` is called [`STEPS`] times where something is
/// measured.
///
/// # Errors
/// [`StudyError`].
pub fn make(options: &PapersOptions, watch: impl Fn()) -> Result<PapersReport, StudyError> {
    let mut figures = Figures::read(options.records.as_deref())?;
    if !options.only_records {
        measure::into(&mut figures, options, watch)?;
    }
    figures.join();
    PapersReport::of(Machine::here(None), options.only_records, &figures)
}
