//! Judges `pairmaskd advise`: the way that it advises for a recording, beside the fastest of all ways, which are measured
//! afresh and in turns.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use pairmaskd::advise::{Effort, Hosts, Sample, Way, Workload, advise, measure_all};
use pairmaskd::cli::machine::Machine;
use pairmaskd::file_error::{Access, FileError};
use pairmaskd::recording::Recording;
use pairmaskd::serve::DaemonSettings;

use super::harness::{Fields, Part, Report, Table, row};
use crate::Result;

/// What is advised takes at most this many times as long as the best way.
const LIMIT: f64 = 1.15;

/// How long an advice may take, and then all ways together.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    pub advice: Duration,
    pub all: Duration,
}

/// The recordings of a folder.
pub fn recordings(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = || -> std::io::Result<Vec<PathBuf>> {
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect()
    };
    let mut files = read().map_err(FileError::of(folder, Access::Read))?;
    files.retain(|file| file.extension().is_some_and(|extension| extension == "pmrec"));
    files.sort();
    if files.is_empty() {
        // A study of nothing would hold.
        return Err(format!("{}: there is no recording (.pmrec)", folder.display()).into());
    }
    Ok(files)
}

/// Judges what is advised for each recording. `watch` is called after each.
pub fn measure(
    files: &[PathBuf],
    settings: DaemonSettings,
    times: Times,
    watch: impl Fn(),
) -> Result<Report> {
    let cores = super::ways::core_count();
    let hosts = Hosts::start(settings)?;
    let (mut rows, mut above) = (Vec::new(), 0);
    for file in files {
        let workload = open(file)?;
        let advice =
            advise(&workload, &hosts, Effort { time: times.advice, cores }, &mut |_, _| ())?;
        let all = measure_all(&workload, &hosts, Effort { time: times.all, cores })?;
        let (row, ratio) = judge(file, &workload, advice.samples[advice.best].way, &all)
            .ok_or("what is advised was not measured again: please report this")?;
        above += u32::from(ratio > LIMIT);
        rows.push(row);
        watch();
    }
    let note = format!("{above} of {} above {LIMIT}", rows.len());
    let mut report = Report::new("advice", vec![Part::text(note)]);
    report.parts.push(Part::Table(Table::of(&rows)));
    report.value("machine", Machine::this());
    report.value("has_gpu", hosts.has_gpu());
    report.list("rows", &rows);
    report.fault = (above > 0).then_some("an advice takes too long beside the best way");
    Ok(report)
}

fn open(file: &Path) -> Result<Workload> {
    let opened = File::open(file).map_err(FileError::of(file, Access::Read))?;
    let mut recording = Recording::open(BufReader::new(opened))?;
    Ok(Workload::of_recording(&mut recording)?)
}

/// The advised way beside the best of those that may be advised.
fn judge(file: &Path, workload: &Workload, advised: Way, all: &[Sample]) -> Option<(Fields, f64)> {
    let may_be = |sample: &&Sample| workload.accepts_near || !sample.way.is_near();
    let best = all.iter().filter(may_be).min_by_key(|sample| sample.figures.usual_ns)?;
    let own = all.iter().find(|sample| sample.way == advised)?;
    let (advised_ns, best_ns) = (own.figures.usual_ns, best.figures.usual_ns);
    let ratio = advised_ns as f64 / best_ns.max(1) as f64;
    let row = row!(
        recording: file.file_stem().unwrap_or_default().to_string_lossy(),
        boxes: workload.boxes(),
        ways: all.len(),
        ratio,
        advised: advised.to_string(),
        advised_ns,
        best: best.way.to_string(),
        best_ns,
    );
    Some((row, ratio))
}

#[cfg(test)]
mod tests {
    use pairmaskd::advise::{Answer, Figures, Host, Means, ways};

    use super::*;

    #[test]
    fn an_advice_is_judged_by_the_best_of_those_that_may_be_advised() {
        let boxes = vec![pairmask::Aabb::new([0.0; 3], [1.0; 3]); 5];
        let workload = Workload::of_boxes(boxes, 0.5, Answer::Pairs).expect("boxes");
        let means = Means { cores: 2, has_gpu: false };
        let sample = |way: Way| {
            let usual_ns = match way.host {
                _ if way.is_near() => 10,
                Host::InProcess => 100,
                _ => 130,
            };
            Sample { way, figures: Figures { usual_ns, ..Figures::default() }, rounds: 1 }
        };
        let all: Vec<Sample> = ways(&workload, means).into_iter().map(sample).collect();
        let ratio = |ns: u64| {
            let of = |sample: &&Sample| sample.figures.usual_ns == ns;
            let way = all.iter().find(of).expect("a way").way;
            judge(Path::new("a.pmrec"), &workload, way, &all).expect("measured").1
        };
        assert!((ratio(100) - 1.0).abs() < 1e-9 && ratio(130) > LIMIT);
    }
}
