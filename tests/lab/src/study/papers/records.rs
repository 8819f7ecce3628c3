//! Records of earlier measurements, found by file name below a folder, the newest folder first.

use std::fs;
use std::path::{Path, PathBuf};

use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;
use serde_json::Value;

use super::claims::{Kind, MissingCores};
use super::expression::select;
use crate::Result;

/// Records: their kind, file, and the lists that they must have.
const FILES: [(Kind, &str, &[&str]); 6] = [
    (
        Kind::Mapping,
        "mapping.json",
        &["root_errors", "pair_errors", "map_times", "root_times", "outputs", "growth"],
    ),
    (Kind::Grid, "grid.json", &["parts", "with_and_without", "engines", "moving"]),
    (Kind::Threads, "threads.json", &["rows"]),
    (Kind::Spheres, "spheres.json", &[]),
    (Kind::Spheres, "spheres-errors.json", &[]),
    (Kind::TwoGpus, "several-gpus.json", &["scenes"]),
];

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Source {
    /// The record's path below the folder, or "this run".
    pub from: String,
    pub machine: String,
    #[serde(skip)]
    pub data: Value,
}

/// All that the claims are judged by: this run first, then records, the newest folder first.
#[derive(Clone, Debug, Default)]
pub struct Figures(Vec<(Kind, Source)>);

impl Figures {
    /// All records in the folders of a folder; none without one.
    pub fn read(records: Option<&Path>) -> Result<Self> {
        let mut figures = Self::default();
        let Some(records) = records else { return Ok(figures) };
        let entries = fs::read_dir(records).map_err(FileError::of(records, Access::Read))?;
        let paths = entries.map(|entry| entry.map(|entry| entry.path()));
        let paths: Result<Vec<PathBuf>, _> = paths.collect();
        let mut folders = paths.map_err(FileError::of(records, Access::Read))?;
        folders.retain(|path| path.is_dir());
        folders.sort_unstable_by(|a, b| b.cmp(a));
        for folder in folders {
            for (kind, name, lists) in FILES {
                let path = folder.join(name);
                if !path.is_file() {
                    continue;
                }
                let text = fs::read_to_string(&path).map_err(FileError::of(&path, Access::Read))?;
                let read = serde_json::from_str(&text).map_err(|error| error.to_string());
                let data = read.and_then(|data| checked(kind, data, lists));
                let wrong = |why| format!("{}: not such a record: {why}", path.display());
                let day = folder.file_name().map(|day| day.to_string_lossy()).unwrap_or_default();
                let source = Source::new(format!("{day}/{name}"), data.map_err(wrong)?);
                figures.0.push((kind, source));
            }
        }
        Ok(figures)
    }

    fn all(&self, kind: Kind) -> impl Iterator<Item = &Source> {
        self.0.iter().filter(move |(of, _)| *of == kind).map(|(_, source)| source)
    }

    /// Puts a report of this run before the records, read as its record would be.
    pub fn add_run(&mut self, kind: Kind, report: &impl Serialize) -> Result<()> {
        let data = checked(kind, serde_json::to_value(report)?, &[])?;
        self.0.insert(0, (kind, Source::new("this run".to_owned(), data)));
        Ok(())
    }

    /// Brings together grids and threads of the same machine, and adds what is no record.
    pub fn join(&mut self) {
        let mut joined = Vec::new();
        for grid in self.all(Kind::Grid).filter(|grid| grid.is_on_gpu()) {
            for threads in self.all(Kind::Threads) {
                if grid.data["machine"]["cpu"] == threads.data["machine"]["cpu"] {
                    let mut data = threads.data.clone();
                    data["grid"] = grid.data.clone();
                    let from = format!("{}, {}", grid.from, threads.from);
                    joined.push((Kind::GridAndThreads, Source::new(from, data)));
                }
            }
        }
        self.0.extend(joined);
        let build = Source { from: "this build".to_owned(), ..Source::default() };
        self.0.push((Kind::Build, build));
    }

    /// The sources of a kind; with `on_gpu` those whose GPU is none of software, whose times say nothing of GPUs.
    pub fn sources(&self, kind: Option<Kind>, on_gpu: bool) -> impl Iterator<Item = &Source> {
        let all = kind.into_iter().flat_map(|kind| self.all(kind));
        all.filter(move |source| !on_gpu || source.is_on_gpu())
    }

    /// All records and runs, by kind.
    pub fn all_sources(&self) -> impl Iterator<Item = &Source> {
        let kinds = [Kind::Mapping, Kind::Grid, Kind::Threads, Kind::Spheres, Kind::TwoGpus];
        kinds.into_iter().flat_map(|kind| self.all(kind))
    }

    pub fn without_cores(&self, requested: &MissingCores) -> String {
        let MissingCores { scene, n, cores } = requested;
        let row = format!("rows[stage=update-aabbs,scene={scene},n={n},threads=1]");
        let measures = |source: &&Source| !select(&source.data, &row).is_empty();
        let measured = self.all(Kind::Threads).filter(measures);
        match measured.map(|source| core_count(&source.data)).max() {
            Some(most) if most < *cores => format!(
                "no machine of {cores} cores was measured with {n} boxes of {scene}: the largest has {most}"
            ),
            Some(_) => format!("`threads` has no row of {cores} threads for {n} boxes of {scene}"),
            None => format!("no record and no run has {n} boxes of {scene}"),
        }
    }
}

impl Source {
    fn new(from: String, data: Value) -> Self {
        let text = |name: &str| data["machine"][name].as_str().unwrap_or_default();
        let gpu = if text("gpu").is_empty() { String::new() } else { format!(", {}", text("gpu")) };
        let (cpu, threads, commit) = (text("cpu"), core_count(&data), text("commit"));
        let machine =
            format!("{cpu}, {threads} threads{gpu}; commit {commit}; {}", text("command"));
        Self { from, machine, data }
    }

    fn is_on_gpu(&self) -> bool {
        self.data["machine"]["gpu_is_software"] != true
    }
}

/// Cores of a record; `threads.json` calls them so, others threads.
fn core_count(data: &Value) -> u64 {
    let machine = &data["machine"];
    machine["threads"].as_u64().or(machine["cores"].as_u64()).unwrap_or(0)
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
    let cores = core_count(&data);
    match kind {
        Kind::Threads => {
            let Some(rows) = data["rows"].as_array_mut() else { return Ok(data) };
            rows.retain(|row| row["threads"].as_u64().is_some_and(|threads| threads <= cores));
            for row in rows {
                row["ms"] = row["least_ns"].as_f64().map(|ns| ns / 1e6).into();
            }
        }
        Kind::TwoGpus => simulate(&mut data),
        _ => {}
    }
    Ok(data)
}

/// What a second GPU costs beside its share: another wait, and its submissions. Measured, `several-gpus.txt`.
const ANOTHER_GPU_MS: f64 = 0.035;
/// A link's bandwidth, bytes a millisecond: 54 GB/s, measured (`several-gpus.txt`).
const LINK_BYTES_A_MS: f64 = 54e6;
const BOX_BYTES: f64 = 24.0;

/// Time of a frame of n boxes on so many GPUs, ms, simulated from the measured times of one and of two.
///
/// A frame on k GPUs takes what none of them can share, the k-th part of what they share, and the host's work for
/// each further one. Each reads all boxes over its own link, which is part of what they do not share; boxes that the
/// client writes slab by slab (`in_slabs`) would be, which nothing does today.
pub fn ms_on_gpus([one, two]: [f64; 2], n: f64, gpus: u32, in_slabs: bool) -> f64 {
    let reading = (n * BOX_BYTES / LINK_BYTES_A_MS).min(one);
    // Two GPUs save half of what they share, and cost what another one costs.
    let shared = (2.0 * (one + ANOTHER_GPU_MS - two)).clamp(0.0, one - reading);
    let whole = one - reading - shared;
    let k = f64::from(gpus);
    let reading = if in_slabs { reading / k } else { reading };
    reading + whole + shared / k + ANOTHER_GPU_MS * (k - 1.0)
}

/// Adds to a record of one GPU beside two what the claims ask of the scene that gains most from the second.
fn simulate(data: &mut Value) {
    let mut best = (0.0, String::new(), [0.0; 2], 0.0);
    for row in data["scenes"].as_array().into_iter().flatten() {
        let number = |name: &str| row[name].as_f64();
        let (Some(one), Some(two), Some(n)) = (number("one_ms"), number("two_ms"), number("n"))
        else {
            continue;
        };
        if one / two > best.0 {
            best = (one / two, row["scene"].as_str().unwrap_or_default().to_owned(), [one, two], n);
        }
    }
    let (gain, scene, both, n) = best;
    let ms = |gpus, in_slabs| ms_on_gpus(both, n, gpus, in_slabs);
    data["of_scene"] = format!("{scene}, ").into();
    data["two_over_one"] = gain.into();
    data["four_over_one"] = (ms(1, false) / ms(4, false)).into();
    data["four_over_one_in_slabs"] = (ms(1, true) / ms(4, true)).into();
    data["eight_over_four"] = (ms(4, false) / ms(8, false)).into();
}
