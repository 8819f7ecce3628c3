//! Records of earlier measurements, found by file name below a folder, the newest folder first.

use std::fs;
use std::path::{Path, PathBuf};

use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::PapersError;
use super::shapes::{Grid, Mapping, RecordMachine, Spheres, Threads, TwoGpus};
use super::text::{gpu_spheres, machine_line, two_gpus};

/// Figures and where they come from.
#[derive(Clone, Debug)]
pub struct Sourced<T> {
    /// The record's path below the folder, or "this run".
    pub from: String,
    /// The machine.
    pub machine: String,
    /// Whether the GPU is a software adapter, whose times say nothing of GPUs.
    pub gpu_is_software: bool,
    /// The figures.
    pub data: T,
}

impl<T> Sourced<T> {
    fn new(from: &str, machine: &RecordMachine, data: T) -> Self {
        let gpu = machine.gpu.as_ref().map(|gpu| format!(", {gpu}")).unwrap_or_default();
        let RecordMachine { cpu, threads, commit, command, .. } = machine;
        Self {
            from: from.to_owned(),
            machine: format!("{cpu}, {threads} threads{gpu}; commit {commit}; {command}"),
            gpu_is_software: machine.gpu_is_software,
            data,
        }
    }
}

/// A report with a machine.
pub trait Measured: DeserializeOwned {
    /// The machine that was measured.
    fn machine(&self) -> &RecordMachine;
}

macro_rules! measured {
    ($($report:ty),*) => {$(
        impl Measured for $report {
            fn machine(&self) -> &RecordMachine {
                &self.machine
            }
        }
    )*};
}
measured!(Mapping, Grid, Threads, Spheres);

/// All that the claims are judged by: this run first, then records, the newest folder first.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// The mapping study.
    pub mapping: Vec<Sourced<Mapping>>,
    /// The grid study.
    pub grid: Vec<Sourced<Grid>>,
    /// Speed-up by threads.
    pub threads: Vec<Sourced<Threads>>,
    /// Spheres, on cores and on GPUs.
    pub spheres: Vec<Sourced<Spheres>>,
    /// One GPU and two.
    pub two_gpus: Vec<Sourced<Vec<TwoGpus>>>,
}

impl Figures {
    /// All records in the folders of a folder; none without one.
    ///
    /// # Errors
    /// [`PapersError`] where a folder cannot be listed, or a record is not read or is another thing.
    pub fn read(records: Option<&Path>) -> Result<Self, PapersError> {
        let mut figures = Self::default();
        let folders = records.map_or(Ok(Vec::new()), newest_first)?;
        for folder in &folders {
            figures.mapping.extend(json(folder, "mapping.json")?);
            figures.grid.extend(json(folder, "grid.json")?);
            figures.threads.extend(json(folder, "threads.json")?);
            figures.spheres.extend(json(folder, "spheres.json")?);
            figures.spheres.extend(json(folder, "spheres-errors.json")?);
            figures.spheres.extend(text(folder, "spheres.txt", gpu_spheres)?);
            figures.two_gpus.extend(text(folder, "several-gpus.txt", two_gpus)?);
        }
        Ok(figures)
    }

    /// Every source and its machine, once.
    pub fn sources(&self) -> Vec<(String, String)> {
        fn names<T>(sources: &[Sourced<T>]) -> impl Iterator<Item = (String, String)> {
            sources.iter().map(|source| (source.from.clone(), source.machine.clone()))
        }
        let all = names(&self.mapping).chain(names(&self.grid)).chain(names(&self.threads));
        all.chain(names(&self.spheres)).chain(names(&self.two_gpus)).collect()
    }
}

/// The sources whose GPU is none of software.
pub fn on_gpus<T>(sources: &[Sourced<T>]) -> impl Iterator<Item = &Sourced<T>> {
    sources.iter().filter(|source| !source.gpu_is_software)
}

/// A report of this run, read as its record would be.
///
/// # Errors
/// [`PapersError::Json`].
pub fn of_this_run<T: Measured>(report: &impl Serialize) -> Result<Sourced<T>, PapersError> {
    let data: T = serde_json::from_value(serde_json::to_value(report)?)?;
    let machine = data.machine().clone();
    Ok(Sourced::new("this run", &machine, data))
}

/// The folders of a folder, by name: names begin with the day.
fn newest_first(records: &Path) -> Result<Vec<PathBuf>, PapersError> {
    let entries = fs::read_dir(records).map_err(FileError::of(records, Access::Read))?;
    let mut folders = Vec::new();
    for entry in entries {
        let path = entry.map_err(FileError::of(records, Access::Read))?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort_unstable_by(|a, b| b.cmp(a));
    Ok(folders)
}

/// The text of a record and its name below the folder of all records; `None` where there is none.
fn load(folder: &Path, name: &str) -> Result<Option<(PathBuf, String, String)>, PapersError> {
    let path = folder.join(name);
    if !path.is_file() {
        return Ok(None);
    }
    let text = fs::read_to_string(&path).map_err(FileError::of(&path, Access::Read))?;
    let day = folder.file_name().map(|day| day.to_string_lossy()).unwrap_or_default();
    let from = format!("{day}/{name}");
    Ok(Some((path, from, text)))
}

fn json<T: Measured>(folder: &Path, name: &str) -> Result<Option<Sourced<T>>, PapersError> {
    let Some((path, from, text)) = load(folder, name)? else { return Ok(None) };
    let data: T = serde_json::from_str(&text)
        .map_err(|error| PapersError::Record { path, why: error.to_string() })?;
    let machine = data.machine().clone();
    Ok(Some(Sourced::new(&from, &machine, data)))
}

fn text<T>(
    folder: &Path,
    name: &str,
    read: fn(&str) -> Result<T, &'static str>,
) -> Result<Option<Sourced<T>>, PapersError> {
    let Some((path, from, text)) = load(folder, name)? else { return Ok(None) };
    let data = read(&text).map_err(|why| PapersError::Record { path, why: why.to_owned() })?;
    let machine = machine_line(&text).to_owned();
    Ok(Some(Sourced { from, machine, gpu_is_software: false, data }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const THREADS: &str = r#"{"machine":{"cpu":"C","cores":4},"rows":[]}"#;

    #[test]
    fn the_newest_folder_comes_first_and_a_broken_record_is_an_error() {
        let place = tempfile::tempdir().expect("a folder");
        for day in ["2026-01-01-a", "2026-02-01-b"] {
            fs::create_dir(place.path().join(day)).expect("a folder");
            fs::write(place.path().join(day).join("threads.json"), THREADS).expect("a file");
        }
        let figures = Figures::read(Some(place.path())).expect("records");
        let from: Vec<_> = figures.threads.iter().map(|source| source.from.as_str()).collect();
        assert_eq!(from, ["2026-02-01-b/threads.json", "2026-01-01-a/threads.json"]);
        assert_eq!(figures.threads[0].data.machine.threads, 4);
        fs::write(place.path().join("2026-01-01-a/grid.json"), "{}").expect("a file");
        let error = Figures::read(Some(place.path())).expect_err("no grid");
        assert!(matches!(error, PapersError::Record { .. }), "{error}");
        assert!(error.to_string().contains("grid.json"), "{error}");
        assert!(Figures::read(None).expect("nothing").sources().is_empty());
    }
}
