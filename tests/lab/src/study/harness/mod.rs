//! What all studies share: one error, one way to write results, tables, plots, medians, stages on a device.

pub mod document;
pub mod machine;
pub mod plot;
pub mod stage_bench;
pub mod table;
pub mod unit;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::study::ways::MeasureError;
use pairmask::ConnectError;
use pairmask_core::update::UpdateError;
use pairmaskd::cli::output::{OutputError, print_json, print_text};
use pairmaskd::execute::gpu::{Gpu, GpuChoice, GpuError, HostImport, OpenError};
use pairmaskd::file_error::{Access, FileError};
use pairmaskd::spawn::SpawnError;
use pairmaskd::timed_client::TimedError;
use serde::Serialize;

use self::document::{Part, markdown};
use self::table::Table;
use crate::gpu_stages::BenchError;
use crate::study::papers::expression::BadExpression;

/// Why a study failed, or what it found wrong.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The GPU that was asked for does not exist.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The GPU failed on the way.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame failed, or had other pairs than the CPU's.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// Threads or an engine failed.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// Boxes and transforms differ in number.
    #[error(transparent)]
    Update(#[from] UpdateError),
    /// The daemon of a measurement did not start.
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// No session with the daemon.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// A frame of a session failed.
    #[error(transparent)]
    Timed(#[from] TimedError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The report has no JSON form, or was not printed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// An engine found other pairs than the cores' grid.
    #[error("{n} boxes of {scene}: the pairs of {engine} are not those of the cores")]
    Wrong {
        /// The engine.
        engine: &'static str,
        /// The scene.
        scene: String,
        /// Boxes.
        n: u32,
    },
    /// Spheres were decided wrongly; the report names the family.
    #[error("pairs of spheres were decided wrongly: please report this")]
    InexactSpheres,
    /// A record is not what its name says.
    #[error("{}: not such a record: {why}", path.display())]
    Record {
        /// The record.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The table of the papers' claims is broken.
    #[error(transparent)]
    Claims(#[from] BadExpression),
    /// A file to compare with is none of `accuracy`.
    #[error("{} is no report of `accuracy --json`: {source}", path.display())]
    NoReport {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// A report to compare with is about other rows.
    #[error("{} and this report have no row in common: compare like with like", path.display())]
    NothingInCommon {
        /// The file.
        path: PathBuf,
    },
    /// Nothing is left to measure.
    #[error("no row: every engine asked for would take too long on every scene")]
    NoRow,
    /// Rows do not keep the limits.
    #[error("{failures} limits are not kept, the first: {first}")]
    Assertion {
        /// How many.
        failures: usize,
        /// The first.
        first: String,
    },
}

impl From<serde_json::Error> for StudyError {
    fn from(error: serde_json::Error) -> Self {
        Self::Output(error.into())
    }
}

/// The results of a study.
pub trait Report: Serialize {
    /// The name of its files.
    const NAME: &'static str;

    /// What it says.
    fn parts(&self) -> Vec<Part>;

    /// Its lists of rows, by name, for CSV.
    fn tables(&self) -> Vec<(&'static str, Table)> {
        Vec::new()
    }

    /// All rows as CSV, each list below a line with its name where there are several.
    fn csv(&self) -> String {
        match &self.tables()[..] {
            [(_, one)] => one.csv(),
            all => {
                let text = |(name, table): &(_, Table)| format!("# {name}\n{}", table.csv());
                all.iter().map(text).collect::<Vec<_>>().concat()
            }
        }
    }

    /// Its files beside `NAME.json`: name and content.
    fn files(&self) -> Vec<(String, String)> {
        let file = |kind: &str, text| (format!("{}.{kind}", Self::NAME), text);
        let mut files = vec![file("md", markdown(&self.parts()))];
        if !self.tables().is_empty() {
            files.push(file("csv", self.csv()));
        }
        files
    }
}

/// How results are printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Print {
    /// For a reader.
    #[default]
    Text,
    /// As one JSON object.
    Json,
    /// As CSV.
    Csv,
}

/// Writes the files of a report into a folder, if there is one, which is made, and prints the report.
///
/// # Errors
/// [`StudyError::File`], [`StudyError::Output`].
pub fn deliver<R: Report>(report: &R, out: Option<&Path>, print: Print) -> Result<(), StudyError> {
    if let Some(folder) = out {
        write_files(report, folder)?;
    }
    match print {
        Print::Text => print_text(markdown(&report.parts()).trim_end())?,
        Print::Json => print_json(report)?,
        Print::Csv => print_text(report.csv().trim_end())?,
    }
    Ok(())
}

/// Writes the files of a report into a folder, which is made.
///
/// # Errors
/// [`StudyError::File`], [`StudyError::Output`].
pub fn write_files<R: Report>(report: &R, folder: &Path) -> Result<(), StudyError> {
    let json = serde_json::to_string_pretty(report)? + "\n";
    fs::create_dir_all(folder).map_err(FileError::of(folder, Access::WriteInto))?;
    for (name, content) in report.files().into_iter().chain([(format!("{}.json", R::NAME), json)]) {
        let path = folder.join(name);
        fs::write(&path, content).map_err(FileError::of(path, Access::Write))?;
    }
    Ok(())
}

/// The GPU of a study that goes on without one: `None` with [`GpuChoice::None`], and with
/// [`GpuChoice::Auto`] on a machine without one.
///
/// # Errors
/// [`OpenError`].
pub fn open_if_any(choice: &GpuChoice) -> Result<Option<Arc<Gpu>>, OpenError> {
    if *choice == GpuChoice::None {
        // Adapters are not even listed: that loads every driver, and some print on stderr.
        return Ok(None);
    }
    match Gpu::open(choice, HostImport::Never) {
        Ok(gpu) => Ok(Some(gpu)),
        Err(OpenError::NoAdapter { .. }) if *choice == GpuChoice::Auto => {
            log::info!("no GPU: the CPU alone is measured");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// The middle value; NaN of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The results of as many runs as the budget has time for, `least` at least.
///
/// # Errors
/// The first error of a run.
pub fn repeated<T, E>(
    budget: Duration,
    least: usize,
    mut run: impl FnMut() -> Result<T, E>,
) -> Result<Vec<T>, E> {
    let mut results = Vec::new();
    let started = Instant::now();
    while results.len() < least || started.elapsed() < budget {
        results.push(run()?);
    }
    Ok(results)
}

/// Median time of a run by the host's clock, ms; three runs at least.
pub fn median_ms(budget: Duration, mut run: impl FnMut()) -> f64 {
    let timed = || {
        let start = Instant::now();
        run();
        Ok::<_, std::convert::Infallible>(start.elapsed().as_secs_f64() * 1e3)
    };
    repeated(budget, 3, timed).map_or(f64::NAN, median)
}
