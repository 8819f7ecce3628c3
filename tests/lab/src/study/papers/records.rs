//! Records of earlier measurements, found by file name below a folder, the newest folder first.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::claims::{ClaimSource, Kind, MissingCores};
use super::several_gpus::{self, TwoGpus};
use crate::study::harness::StudyError;

/// Figures and where they come from.
#[derive(Clone, Debug)]
struct Sourced {
    /// The record's path below the folder, or "this run".
    from: String,
    /// The machine.
    machine: String,
    data: Value,
}

/// Records that are JSON: their kind, file, and the lists that they must have.
const JSON: [(Kind, &str, &[&str]); 5] = [
    (
        Kind::Mapping,
        "mapping.json",
        &["root_errors", "pair_errors", "map_times", "root_times", "outputs", "growth"],
    ),
    (Kind::Grid, "grid.json", &["parts", "with_and_without", "engines", "moving"]),
    (Kind::Threads, "threads.json", &["rows"]),
    (Kind::Spheres, "spheres.json", &[]),
    (Kind::Spheres, "spheres-errors.json", &[]),
];

/// Reads a record that is text; an error says what is missing.
type ReadText = fn(&str) -> Result<Value, &'static str>;
/// Records that are text.
const TEXT: [(Kind, &str, ReadText); 2] =
    [(Kind::Spheres, "spheres.txt", gpu_spheres), (Kind::TwoGpus, "several-gpus.txt", two_gpus)];

/// All that the claims are judged by: this run first, then records, the newest folder first.
#[derive(Clone, Debug, Default)]
pub struct Figures(BTreeMap<Kind, Vec<Sourced>>);

impl Figures {
    /// All records in the folders of a folder; none without one.
    ///
    /// # Errors
    /// [`StudyError`] where a folder cannot be listed, or a record is not read or is another thing.
    pub fn read(records: Option<&Path>) -> Result<Self, StudyError> {
        let mut figures = Self::default();
        for folder in records.map_or(Ok(Vec::new()), newest_first)? {
            for (kind, name, lists) in JSON {
                let Some((path, from, text)) = load(&folder, name)? else { continue };
                let read = serde_json::from_str(&text).map_err(|error| error.to_string());
                let data = read.and_then(|data| checked(kind, data, lists));
                let data = data.map_err(|why| StudyError::Record { path, why })?;
                figures.of(kind).push(Sourced { from, machine: machine_text(&data), data });
            }
            for (kind, name, read) in TEXT {
                let Some((path, from, text)) = load(&folder, name)? else { continue };
                let data =
                    read(&text).map_err(|why| StudyError::Record { path, why: why.to_owned() })?;
                let machine = text.lines().next().unwrap_or_default().trim_end_matches('.');
                figures.of(kind).push(Sourced { from, machine: machine.to_owned(), data });
            }
        }
        Ok(figures)
    }

    fn of(&mut self, kind: Kind) -> &mut Vec<Sourced> {
        self.0.entry(kind).or_default()
    }

    fn all(&self, kind: Kind) -> &[Sourced] {
        self.0.get(&kind).map_or(&[], Vec::as_slice)
    }

    /// Puts a report of this run before the records, read as its record would be.
    ///
    /// # Errors
    /// [`StudyError::Output`], [`StudyError::Record`].
    pub fn add_run(&mut self, kind: Kind, report: &impl Serialize) -> Result<(), StudyError> {
        let data = checked(kind, serde_json::to_value(report)?, &[])
            .map_err(|why| StudyError::Record { path: "this run".into(), why })?;
        let source = Sourced { from: "this run".to_owned(), machine: machine_text(&data), data };
        self.of(kind).insert(0, source);
        Ok(())
    }

    /// Brings together grids and threads of the same machine.
    pub fn join(&mut self) {
        let mut joined = Vec::new();
        for grid in self.all(Kind::Grid).iter().filter(|grid| is_on_gpu(&grid.data)) {
            for threads in self.all(Kind::Threads) {
                if grid.data["machine"]["cpu"] == threads.data["machine"]["cpu"] {
                    let mut data = threads.data.clone();
                    data["grid"] = grid.data.clone();
                    let from = format!("{}, {}", grid.from, threads.from);
                    joined.push(Sourced { from, machine: grid.machine.clone(), data });
                }
            }
        }
        self.0.insert(Kind::GridAndThreads, joined);
    }

    /// The sources of a kind; with `on_gpu` those whose GPU is none of software, whose times say nothing of GPUs.
    pub fn sources(&self, kind: Option<Kind>, on_gpu: bool) -> Vec<ClaimSource<'_>> {
        match kind {
            None => Vec::new(),
            Some(Kind::Build) => {
                vec![ClaimSource { from: "this build".to_owned(), data: &Value::Null }]
            }
            Some(kind) => {
                let sources = self.all(kind).iter().filter(|s| !on_gpu || is_on_gpu(&s.data));
                sources.map(|s| ClaimSource { from: s.from.clone(), data: &s.data }).collect()
            }
        }
    }

    /// Every record and this run with its machine.
    pub fn machines(&self) -> impl Iterator<Item = (&str, &str)> {
        let kinds =
            [Kind::Mapping, Kind::Grid, Kind::Threads, Kind::Spheres, Kind::TwoGpus].into_iter();
        kinds.flat_map(|kind| self.all(kind)).map(|s| (s.from.as_str(), s.machine.as_str()))
    }

    /// Why there is no figure on so many cores.
    pub fn without_cores(&self, wanted: &MissingCores) -> String {
        let MissingCores { scene, n, cores } = wanted;
        let measures = |source: &&Sourced| {
            source.data["rows"].as_array().into_iter().flatten().any(|row| {
                row["stage"] == "update-aabbs"
                    && row["scene"] == scene.as_str()
                    && row["n"] == *n
                    && row["threads"] == 1
            })
        };
        let measured = self.all(Kind::Threads).iter().filter(measures);
        match measured.map(|source| core_count(&source.data)).max() {
            Some(most) if most < *cores => format!(
                "no machine of {cores} cores was measured with {n} boxes of {scene}: the largest has {most}"
            ),
            Some(_) => format!("`threads` has no row of {cores} threads for {n} boxes of {scene}"),
            None => format!("no record and no run has {n} boxes of {scene}"),
        }
    }
}

fn is_on_gpu(data: &Value) -> bool {
    data["machine"]["gpu_is_software"] != true
}

/// Cores of a record; `threads.json` calls them so, others threads.
fn core_count(data: &Value) -> u64 {
    let machine = &data["machine"];
    machine["threads"].as_u64().or(machine["cores"].as_u64()).unwrap_or(0)
}

fn machine_text(data: &Value) -> String {
    let text = |name: &str| data["machine"][name].as_str().unwrap_or_default();
    let gpu = match text("gpu") {
        "" => String::new(),
        gpu => format!(", {gpu}"),
    };
    let (cpu, threads) = (text("cpu"), core_count(data));
    format!("{cpu}, {threads} threads{gpu}; commit {}; {}", text("commit"), text("command"))
}

/// A record that has the lists of its kind. Rows of `threads` get their least time in ms; those of more threads than
/// cores are left out: threads that take turns on one core say nothing of a core more.
fn checked(kind: Kind, mut data: Value, lists: &[&str]) -> Result<Value, String> {
    if !data.is_object() {
        return Err("it is no object".to_owned());
    }
    if let Some(absent) = lists.iter().find(|name| !data[**name].is_array()) {
        return Err(format!("it has no list `{absent}`"));
    }
    if kind == Kind::Threads {
        let cores = core_count(&data);
        if let Some(rows) = data["rows"].as_array_mut() {
            rows.retain(|row| row["threads"].as_u64().is_some_and(|threads| threads <= cores));
            for row in rows {
                row["ms"] = row["least_ns"].as_f64().map(|ns| ns / 1e6).into();
            }
        }
    }
    Ok(data)
}

/// The folders of a folder, by name: names begin with the day.
fn newest_first(records: &Path) -> Result<Vec<PathBuf>, StudyError> {
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
fn load(folder: &Path, name: &str) -> Result<Option<(PathBuf, String, String)>, StudyError> {
    let path = folder.join(name);
    if !path.is_file() {
        return Ok(None);
    }
    let text = fs::read_to_string(&path).map_err(FileError::of(&path, Access::Read))?;
    let day = folder.file_name().map(|day| day.to_string_lossy()).unwrap_or_default();
    let from = format!("{day}/{name}");
    Ok(Some((path, from, text)))
}

/// The table that `pairmask-lab spheres --gpu` prints. Columns stand between bars: spheres and pairs; one by one, all
/// pairs, tests a second, speed-up; others.
pub(super) fn gpu_spheres(text: &str) -> Result<Value, &'static str> {
    let row = |line: &str| {
        let mut groups = line.split('|');
        let n: u64 = groups.next()?.split_whitespace().next()?.parse().ok()?;
        let figures: Vec<f64> =
            groups.next()?.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let mut row = Map::from_iter([("n".to_owned(), json!(n))]);
        // Large numbers of spheres have no frame of one by one: what is left cannot be told apart.
        if let [plain, all_pairs, _tests, _speed_up] = figures[..] {
            row.insert("plain_fps".to_owned(), json!(plain));
            row.insert("all_pairs_fps".to_owned(), json!(all_pairs));
        }
        Some(Value::Object(row))
    };
    let mut lines = text.lines().skip_while(|line| !line.contains("one by one"));
    lines.next().ok_or("no table of spheres on the GPU")?;
    match lines.map_while(row).collect::<Vec<_>>() {
        rows if rows.is_empty() => Err("the table of spheres on the GPU has no row"),
        rows => Ok(json!({ "gpu_speed": rows })),
    }
}

/// The tables of one GPU beside two, as the claims ask for them.
fn two_gpus(text: &str) -> Result<Value, &'static str> {
    Ok(several_gpus::figures(&scenes_of_two_gpus(text)?))
}

/// The tables of one GPU beside two: a scene's name, the runs of each, ratios. Columns are apart by two spaces at
/// least, the runs of a column by one.
pub(super) fn scenes_of_two_gpus(text: &str) -> Result<Vec<TwoGpus>, &'static str> {
    let scene = |line: &str| {
        let mut columns = line.split("  ").map(str::trim).filter(|column| !column.is_empty());
        let scene = columns.next()?.to_owned();
        Some(TwoGpus { scene, one_ms: middle(columns.next()?)?, two_ms: middle(columns.next()?)? })
    };
    let mut scenes = Vec::new();
    let mut in_table = false;
    for line in text.lines() {
        if line.contains("one GPU") && line.contains("two GPUs") && line.contains("ratio") {
            in_table = true;
        } else if line.trim().is_empty() {
            in_table = false;
        } else if in_table {
            scenes.push(scene(line).ok_or("a row of one GPU beside two has no runs")?);
        }
    }
    if scenes.is_empty() { Err("no table of one GPU beside two") } else { Ok(scenes) }
}

/// The middle run, of an even number the mean of both.
fn middle(runs: &str) -> Option<f64> {
    let mut runs: Vec<f64> = runs.split(' ').filter_map(|run| run.parse().ok()).collect();
    runs.sort_by(f64::total_cmp);
    let (low, high) = (runs.len().checked_sub(1)? / 2, runs.len() / 2);
    Some(0.5 * (runs[low] + runs[high]))
}
