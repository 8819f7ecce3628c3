//! The mapping function study: ways from a thread number k to a pair (a, b), with the time and the
//! errors of each.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §3: tables 2 to 5 and figure 4. The paper numbers boxes
//! from 1, this crate from 0; k is the same number in both. Ways that the paper does not have
//! (from the far end, integer searches, folding) are measured beside its own.
//!
//! The parts: [`mirror`] and [`roots`] are the variants, pure; [`errors`] and [`root_errors`] count
//! their errors on the CPU; [`gpu`] counts and times on a device; [`cpu_times`] times on the CPU;
//! [`plan`] lists the measurements, [`rows`] holds the figures with the paper's ([`paper`]),
//! [`claims`] judges the paper's sentences by them, [`report`] writes them down.
//!
//! No variant here serves a client. Production uses `pairmask_core::pair_index` on the host, which is
//! proven exact for every n, and integer searches within a band on the GPU (`pack_dense`).

pub mod claims;
pub mod cpu_times;
pub mod errors;
pub mod gpu;
pub mod layouts;
pub mod mirror;
pub mod paper;
pub mod plan;
pub mod report;
pub mod root_errors;
pub mod roots;
pub mod rows;
pub mod stage;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use pairmaskd::execute::gpu::{Checks, Gpu, GpuChoice, GpuError, HostImport, OpenError};
use pairmaskd::file_error::{Access, advice};

use self::gpu::Bench;
use self::plan::Plan;
pub use self::report::MappingReport;
use super::machine::Machine;

/// Options of the study.
#[derive(Clone, Debug, Default)]
pub struct MappingOptions {
    /// The GPU. With [`GpuChoice::None`], and with [`GpuChoice::Auto`] on a machine without one,
    /// the CPU alone is measured.
    pub gpu: GpuChoice,
    /// Small sizes and few runs, in seconds, for tests. Times mean little.
    pub quick: bool,
    /// Folder for `mapping.csv`, `mapping.json` and `mapping.md`; made if it is not there.
    pub out: Option<PathBuf>,
    /// Print JSON in place of Markdown.
    pub json: bool,
}

/// Why the study failed.
#[derive(Debug, thiserror::Error)]
pub enum MappingError {
    /// The GPU that was asked for does not exist.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The GPU failed on the way.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The report could not be written.
    #[error("{}: {}", folder.display(), advice(Access::WriteInto, error))]
    Write {
        /// The folder.
        folder: PathBuf,
        /// The system's error.
        error: io::Error,
    },
    /// The report could not be printed.
    #[error("the report was not printed: {0}")]
    Print(#[from] io::Error),
    /// The report has no JSON form.
    #[error("the report has no JSON form: {0}")]
    Json(#[from] serde_json::Error),
}

/// Limits of a measurement's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Runs are repeated for this long, three times at least.
    pub time: Duration,
    /// A single run that is expected to take longer is left out.
    pub longest_run: Duration,
    /// Most ids that a CPU measurement maps; the time of more is scaled up.
    pub most_cpu_ids: u64,
}

/// Measures, writes the files that the options ask for, and prints the report to `print`.
///
/// # Errors
/// [`MappingError`].
pub fn run_and_print(
    options: &MappingOptions,
    print: &mut dyn io::Write,
) -> Result<MappingReport, MappingError> {
    let report = measure(options)?;
    if let Some(folder) = &options.out {
        report::write_files(&report, folder)?;
    }
    if options.json {
        writeln!(print, "{}", report::json(&report)?)?;
    } else {
        write!(print, "{}", report::markdown(&report))?;
    }
    Ok(report)
}

/// As [`run_and_print`], to the standard output.
///
/// # Errors
/// [`MappingError`].
///
/// ```no_run
/// use pairmask_lab::study::mapping::{MappingOptions, run};
/// let report = run(&MappingOptions { quick: true, ..Default::default() })?;
/// assert!(!report.pair_errors.is_empty());
/// # Ok::<(), pairmask_lab::study::mapping::MappingError>(())
/// ```
pub fn run(options: &MappingOptions) -> Result<MappingReport, MappingError> {
    run_and_print(options, &mut io::stdout().lock())
}

/// Measures and writes nothing.
///
/// # Errors
/// [`MappingError`].
pub fn measure(options: &MappingOptions) -> Result<MappingReport, MappingError> {
    let gpu = open(&options.gpu)?;
    let software = gpu.as_ref().is_some_and(|gpu| gpu.info().is_software());
    let plan = Plan::new(options.quick, software, rayon::current_num_threads());
    let machine = Machine::here(gpu.as_ref().map(|gpu| gpu.info()));
    let bench = gpu.as_ref().map(|gpu| Bench::new(gpu, Checks::Off)).transpose()?;
    rows::measure(machine, &plan, bench)
}

/// The GPU of a study; `None` with [`GpuChoice::None`], and with [`GpuChoice::Auto`] on a machine
/// without one.
pub(in crate::study) fn open(choice: &GpuChoice) -> Result<Option<Arc<Gpu>>, OpenError> {
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
