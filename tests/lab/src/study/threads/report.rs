//! Speed-ups as text, as CSV, and as the JSON that the README documents.

use std::fmt::{self, Write as _};
use std::fs;
use std::path::Path;

use crate::study::ways::Case;
use pairmask_core::EngineName;
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::output::OutputError;
use pairmaskd::file_error::{Access, FileError};
use serde::Serialize;

use super::{ThreadsError, paper};

/// The papers' two stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// World boxes from transforms.
    UpdateAabbs,
    /// Pairs from boxes.
    OverlappingPairs,
}

impl Stage {
    /// The stage in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::UpdateAabbs => "update-aabbs",
            Self::OverlappingPairs => "overlapping-pairs",
        }
    }
}

/// The JSON object of `threads --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
pub struct ThreadsReport {
    /// The machine of the measurement.
    pub machine: Machine,
    /// One for every stage, scene, size, engine and number of threads.
    pub rows: Vec<ThreadsRow>,
}

/// One number of threads.
#[derive(Debug, Serialize)]
pub struct ThreadsRow {
    stage: Stage,
    scene: &'static str,
    n: usize,
    /// Null for the first stage.
    engine: Option<&'static str>,
    threads: usize,
    frames: usize,
    least_ns: u64,
    median_ns: u64,
    /// Least time of one thread over least time of these.
    speed_up: f64,
    /// The 2014 paper's time of this stage and scene on as many cores, of its own n.
    paper_ns: Option<u64>,
    paper_speed_up: Option<f64>,
}

impl ThreadsRow {
    /// The rows of one stage of a case: (threads, times), of which one has one thread.
    pub fn series(
        stage: Stage,
        case: Case,
        engine: Option<EngineName>,
        series: Vec<(usize, Vec<u64>)>,
    ) -> Vec<Self> {
        let least = |times: &[u64]| times.iter().min().copied().unwrap_or(0);
        let one = series.iter().find(|(threads, _)| *threads == 1);
        let one_ns = one.map_or(0, |(_, times)| least(times));
        let row = |(threads, mut times): (usize, Vec<u64>)| {
            times.sort_unstable();
            let least_ns = least(&times);
            let paper = paper::figures(stage, case.scene, threads);
            Self {
                stage,
                scene: case.scene.as_str(),
                n: case.n,
                engine: engine.map(EngineName::as_str),
                threads,
                frames: times.len(),
                least_ns,
                median_ns: times.get(times.len() / 2).copied().unwrap_or(0),
                speed_up: one_ns as f64 / least_ns.max(1) as f64,
                paper_ns: paper.map(|(ns, _)| ns),
                paper_speed_up: paper.map(|(_, speed_up)| speed_up),
            }
        };
        series.into_iter().map(row).collect()
    }
}

impl ThreadsReport {
    /// One line a row under a line of names.
    pub fn csv(&self) -> String {
        let mut text = "stage,scene,n,engine,threads,frames,least_ns,median_ns,speed_up,paper_ns,paper_speed_up\n".to_owned();
        for row in &self.rows {
            let optional = |x: Option<f64>| x.map(|x| format!("{x:.3}")).unwrap_or_default();
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{},{},{:.3},{},{}",
                row.stage.as_str(),
                row.scene,
                row.n,
                row.engine.unwrap_or_default(),
                row.threads,
                row.frames,
                row.least_ns,
                row.median_ns,
                row.speed_up,
                row.paper_ns.map(|ns| ns.to_string()).unwrap_or_default(),
                optional(row.paper_speed_up),
            );
        }
        text
    }

    /// Writes `threads.csv` and `threads.json` into a folder, which is made.
    ///
    /// # Errors
    /// [`ThreadsError::Write`], [`ThreadsError::Json`].
    pub fn write_files(&self, folder: &Path) -> Result<(), ThreadsError> {
        let json = serde_json::to_string_pretty(self).map_err(OutputError::from)? + "\n";
        fs::create_dir_all(folder)
            .and_then(|()| fs::write(folder.join("threads.csv"), self.csv()))
            .and_then(|()| fs::write(folder.join("threads.json"), json))
            .map_err(FileError::of(folder, Access::WriteInto))?;
        Ok(())
    }
}

impl fmt::Display for ThreadsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}, {} cores; paper: two Xeon X5482", self.machine.cpu, self.machine.cores)?;
        write!(
            f,
            "{:<17} {:>9} {:>8} {:<10} {:>7} {:>11} {:>11} {:>8} {:>9} {:>8}",
            "stage",
            "scene",
            "n",
            "engine",
            "threads",
            "least µs",
            "median µs",
            "speed-up",
            "paper ms",
            "speed-up"
        )?;
        for row in &self.rows {
            let paper_ms =
                row.paper_ns.map_or("-".to_owned(), |ns| format!("{:.2}", ns as f64 / 1e6));
            let paper = row.paper_speed_up.map_or("-".to_owned(), |x| format!("{x:.2}"));
            write!(
                f,
                "\n{:<17} {:>9} {:>8} {:<10} {:>7} {:>11.1} {:>11.1} {:>8.2} {paper_ms:>9} {paper:>8}",
                row.stage.as_str(),
                row.scene,
                row.n,
                row.engine.unwrap_or("-"),
                row.threads,
                row.least_ns as f64 / 1e3,
                row.median_ns as f64 / 1e3,
                row.speed_up,
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use pairmaskd::scene::SceneName;

    use super::*;

    #[test]
    fn speed_ups_are_over_one_thread() {
        let case = Case { scene: SceneName::Cubes, n: 10 };
        let series = vec![(1, vec![500, 400, 900]), (2, vec![200, 300, 250])];
        let rows =
            ThreadsRow::series(Stage::OverlappingPairs, case, Some(EngineName::CpuSap), series);
        assert_eq!((rows[0].speed_up, rows[1].speed_up), (1.0, 2.0));
        assert_eq!((rows[1].least_ns, rows[1].median_ns), (200, 250));
        assert_eq!(rows[1].paper_ns, Some(31_650_000));
    }
}
