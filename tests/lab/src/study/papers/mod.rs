//! The papers, complete: every table and figure of the four papers, theirs beside ours, what holds
//! and what breaks.
//!
//! The parts: `measure` runs the studies, `records` reads what earlier runs left (`shapes`,
//! `text`); one module a paper holds its tables and figures (`avril2009`, `avril2012`,
//! `avril2014`, `suaib2015`) as claims over rows (`model`); `rule` decides; `page` writes.
//!
//! A verdict is a rule's, never a hand's. A figure that nobody measured is `not measured`.

mod avril2009;
mod avril2012;
mod avril2014;
mod avril2014_gpus;
mod measure;
mod model;
mod more_gpus;
mod page;
mod records;
mod report;
mod rule;
mod shapes;
mod speed_up;
mod suaib2015;
mod text;

use std::path::PathBuf;

use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::file_error::FileError;

pub use self::measure::STEPS;
use self::records::Figures;
pub use self::report::PapersReport;
use super::grid::GridError;
use super::machine::Machine;
use super::mapping::MappingError;
use super::threads::ThreadsError;
use crate::gpu_stages::BenchError;

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

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PapersError {
    /// The mapping study failed.
    #[error(transparent)]
    Mapping(#[from] MappingError),
    /// The grid study failed.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The speed-ups failed.
    #[error(transparent)]
    Threads(#[from] ThreadsError),
    /// The spheres on the GPU failed.
    #[error(transparent)]
    Spheres(#[from] BenchError),
    /// A report has no JSON form, or not that of its record.
    #[error("a report is not what its record is: {0}")]
    Json(#[from] serde_json::Error),
    /// A record is not what its name says.
    #[error("{}: not such a record: {why}", path.display())]
    Record {
        /// The record.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A record could not be read, or a file of the page not written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Measures, reads the records, and judges. `watch` is called [`STEPS`] times where something is
/// measured.
///
/// # Errors
/// [`PapersError`].
pub fn make(options: &PapersOptions, watch: impl Fn()) -> Result<PapersReport, PapersError> {
    let mut figures = Figures::read(options.records.as_deref())?;
    if !options.only_records {
        measure::into(&mut figures, options, watch)?;
    }
    Ok(PapersReport::of(Machine::here(None), options.only_records, &figures))
}
