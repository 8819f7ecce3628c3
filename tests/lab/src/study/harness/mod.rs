//! What all studies share: one way to write results, tables, plots, medians.

pub(crate) mod document;
pub(crate) mod machine;
pub mod plot;
pub(crate) mod table;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport, OpenError};
use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;

use self::document::{Part, markdown};
use self::table::Table;
use crate::Result;

pub(crate) trait StudyReport: Serialize + Sized {
    const NAME: &'static str;

    fn parts(&self) -> Vec<Part>;

    /// All its lists of rows as CSV, each below a line with its name where there are several.
    fn csv(&self) -> String {
        match &Table::all_of(self)[..] {
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
        vec![file("md", markdown(&self.parts())), file("csv", self.csv())]
    }
}

pub(crate) fn write_files<R: StudyReport>(report: &R, folder: &Path) -> Result<()> {
    let json = serde_json::to_string_pretty(report)? + "\n";
    fs::create_dir_all(folder).map_err(FileError::of(folder, Access::WriteInto))?;
    for (name, content) in report.files().into_iter().chain([(format!("{}.json", R::NAME), json)]) {
        let path = folder.join(name);
        fs::write(&path, content).map_err(FileError::of(path, Access::Write))?;
    }
    Ok(())
}

/// The GPU of a run that goes on without one: `None` with [`GpuChoice::None`], and with
/// [`GpuChoice::Auto`] on a machine without one.
pub(crate) fn open_if_any(
    choice: &GpuChoice,
    import: HostImport,
) -> Result<Option<Arc<Gpu>>, OpenError> {
    if *choice == GpuChoice::None {
        // Adapters are not even listed: that loads every driver, and some print on stderr.
        return Ok(None);
    }
    match Gpu::open(choice, import) {
        Ok(gpu) => Ok(Some(gpu)),
        Err(OpenError::NoAdapter { .. }) if *choice == GpuChoice::Auto => {
            log::info!("no GPU: the CPU alone takes part");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// A value that so many of a hundred are not above; NaN of none.
pub(crate) fn percentile(mut values: Vec<f64>, percent: usize) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() * percent / 100).copied().unwrap_or(f64::NAN)
}

pub(crate) fn median(values: Vec<f64>) -> f64 {
    percentile(values, 50)
}

pub(crate) fn repeated<T, E>(
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
pub(crate) fn median_ms(budget: Duration, mut run: impl FnMut()) -> f64 {
    let timed = || {
        let start = Instant::now();
        run();
        Ok::<_, std::convert::Infallible>(start.elapsed().as_secs_f64() * 1e3)
    };
    repeated(budget, 3, timed).map_or(f64::NAN, median)
}
