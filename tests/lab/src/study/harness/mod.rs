//! What all studies share: one way to write results, tables, plots, medians.

mod document;
mod plot;
mod table;

pub(crate) use self::document::{Part, html, markdown};
pub(crate) use self::plot::{Plot, pareto_front, value_text};
pub(crate) use self::table::{Fields, Table, fields, number_text, row};

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use indexmap::IndexMap;
use pairmaskd::cli::machine::Machine;
use pairmaskd::execute::gpu::{AdapterInfo, Gpu, GpuChoice, HostImport, OpenError, is_software};
use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;
use serde_json::json;

use crate::Result;

/// The results of a study: values and lists of rows, which are its JSON object, and the document that shows them.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Report {
    /// The name of its files.
    #[serde(skip)]
    name: &'static str,
    #[serde(flatten)]
    pub values: Fields,
    #[serde(flatten)]
    pub lists: IndexMap<&'static str, Vec<Fields>>,
    #[serde(skip)]
    pub parts: Vec<Part>,
    /// A page beside the document: its file, and what it has behind the parts.
    #[serde(skip)]
    pub page: Option<(&'static str, Vec<Part>)>,
    /// The rows of its CSV, where those are not its lists.
    #[serde(skip)]
    pub csv_rows: Option<Table>,
    /// Why the command fails, though it has measured.
    #[serde(skip)]
    pub fault: Option<&'static str>,
}

impl Report {
    pub fn new(name: &'static str, parts: Vec<Part>) -> Self {
        Self { name, parts, ..Self::default() }
    }

    pub fn value(&mut self, name: &str, value: impl Serialize) {
        self.values.insert(name.to_owned(), json!(value));
    }

    /// The machine and build of a study ([`machine_with`]).
    pub fn machine(&mut self, machine: Fields) {
        let text = |name: &str| machine[name].as_str();
        let [cpu, rustc, commit, command] =
            ["cpu", "rustc", "commit", "command"].map(|name| text(name).unwrap_or_default());
        let driver = text("driver").unwrap_or("-");
        let gpu = text("gpu").map_or_else(String::new, |gpu| format!("; {gpu} ({driver})"));
        let either = |name: &str, is_so, what| if machine[name] == is_so { what } else { "" };
        let software =
            either("gpu_is_software", true, " The GPU is software: its times are the CPU's.");
        let debug = either("optimised", false, " **Not optimised: times mean nothing.**");
        let build = format!("{rustc}; commit {commit}.{software}{debug}");
        let threads = &machine["threads"];
        self.parts.push(Part::text(format!("{cpu}, {threads} threads{gpu}; {build}")));
        self.parts.push(Part::text(format!("`{command}`")));
        self.value("machine", machine);
    }

    /// A list of rows that no section shows as it is.
    pub fn list<R: Serialize>(&mut self, name: &'static str, rows: &[R]) {
        self.lists.insert(name, rows.iter().map(fields).collect());
    }

    /// A list of rows, and a section that shows it, unless it is empty.
    pub fn section<R: Serialize>(
        &mut self,
        name: &'static str,
        title: &str,
        note: &str,
        rows: &[R],
    ) {
        self.parts.extend(Part::section(title, note, Table::of(rows)));
        self.list(name, rows);
    }

    /// All its lists as CSV, each below a line with its name where there are several.
    pub fn csv(&self) -> String {
        if let Some(rows) = &self.csv_rows {
            return rows.csv();
        }
        let filled = self.lists.iter().filter(|(_, rows)| !rows.is_empty());
        match &filled.collect::<Vec<_>>()[..] {
            [(_, one)] => Table::of(one).csv(),
            all => {
                let text = |(name, rows): &(&&str, &Vec<Fields>)| {
                    format!("# {name}\n{}", Table::of(rows).csv())
                };
                all.iter().map(text).collect::<Vec<_>>().concat()
            }
        }
    }

    /// Writes its files into a folder, which is made.
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).map_err(FileError::of(folder, Access::WriteInto))?;
        let json = serde_json::to_string_pretty(self)? + "\n";
        let texts = [("json", json), ("csv", self.csv()), ("md", markdown(&self.parts))];
        let mut files = texts.map(|(kind, text)| (format!("{}.{kind}", self.name), text)).to_vec();
        if let Some((file, more)) = &self.page {
            files.push(((*file).to_owned(), html(&[&self.parts[..], more].concat())));
        }
        for (file, text) in files {
            let path = folder.join(file);
            fs::write(&path, text).map_err(FileError::of(path, Access::Write))?;
        }
        Ok(())
    }
}

/// The machine and build of a study, with the GPU that it uses.
pub(crate) fn machine_with(adapter: Option<&AdapterInfo>) -> Fields {
    let Machine { cpu, toolchain, commit, command, .. } = Machine::this();
    row!(
        cpu,
        threads: rayon::current_num_threads(),
        gpu: adapter.map(|a| &a.name),
        driver: adapter.map(|a| format!("{} {}", a.driver, a.driver_info)),
        gpu_is_software: adapter.is_some_and(is_software),
        rustc: toolchain,
        optimised: !cfg!(debug_assertions),
        commit,
        command,
    )
}

/// The GPU of a run that goes on without one, where `auto` finds none, or none is asked for.
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

/// The value that so many of a hundred are not above, by nearest rank: one of the values; NaN of none.
pub(crate) fn percentile(mut values: Vec<f64>, percent: usize) -> f64 {
    values.sort_by(f64::total_cmp);
    let rank = (values.len() * percent).div_ceil(100);
    values.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

pub(crate) fn median(values: Vec<f64>) -> f64 {
    percentile(values, 50)
}

/// Results of runs that are repeated for so long, and so many times at least.
pub(crate) fn repeated<T>(budget: Duration, least: usize, mut run: impl FnMut() -> T) -> Vec<T> {
    let mut results = Vec::new();
    let started = Instant::now();
    while results.len() < least || started.elapsed() < budget {
        results.push(run());
    }
    results
}

/// Median time of a run by the host's clock, ms; three runs at least.
pub(crate) fn median_ms(budget: Duration, mut run: impl FnMut()) -> f64 {
    let timed = || {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64() * 1e3
    };
    median(repeated(budget, 3, timed))
}
