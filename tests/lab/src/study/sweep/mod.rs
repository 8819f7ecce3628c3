//! Sweep and prune on the GPU, beside the grid and all pairs there: whether it wins anywhere.
//!
//! Boxes are sorted along the axis on which each reaches the fewest others, and each is tested against those behind it
//! that it reaches. Where the axis is crowded, the other two are divided into tubes; a box is an entry of each tube
//! that it lies in, and a pair is told in the tube that holds the lower corner of the intersection.
//!
//! Sources: F. Liu, T. Harada, Y. Lee, Y. J. Kim, "Real-time collision culling of a million bodies on graphics
//! processing units", SIGGRAPH Asia 2010; Q. Avril, V. Gouranton, B. Arnaldi, 2014, §3 and §5. No client is served by
//! it.

mod device;
mod engine;
pub mod layouts;
mod measure;
mod plan;
mod report;
mod scenes;
pub mod stage;

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use pairmaskd::execute::gpu::{Gpu, GpuChoice, GpuError, HostImport, OpenError};
use pairmaskd::file_error::{Access, advice};
use serde::Serialize;

pub use self::device::{GpuSweep, SweepError, Swept};
pub use self::plan::SweepPlan;
pub use self::report::markdown;
pub use self::scenes::SweepScene;
use super::machine::Machine;
use crate::gpu_stages::BenchError;

/// Options of the study.
#[derive(Clone, Debug, Default)]
pub struct SweepOptions {
    /// The GPU.
    pub gpu: GpuChoice,
    /// Numbers of boxes.
    pub counts: Vec<u32>,
    /// Short runs, for a look.
    pub quick: bool,
    /// Folder for `sweep.json` and `sweep.md`; made if it is not there.
    pub out: Option<PathBuf>,
    /// Print JSON in place of Markdown.
    pub json: bool,
}

/// Why the study failed.
#[derive(Debug, thiserror::Error)]
pub enum SweepStudyError {
    /// The GPU that was asked for does not exist.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The GPU failed on the way.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Another engine failed.
    #[error(transparent)]
    Bench(#[from] BenchError),
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

/// Parts of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Boxes up, control block and pairs down.
    Transfers,
    /// Boxes to entries.
    Keys,
    /// Entries into order, and their records.
    Sort,
    /// Each against those behind it.
    Pairs,
}

impl Part {
    /// All of them, in order.
    pub const ALL: [Self; 4] = [Self::Transfers, Self::Keys, Self::Sort, Self::Pairs];

    fn of(label: &str) -> Self {
        match label {
            "sweep_keys" => Self::Keys,
            "sweep_pairs" => Self::Pairs,
            label if label.starts_with("sweep_") => Self::Sort,
            _ => Self::Transfers,
        }
    }
}

/// What a sweep took.
#[derive(Clone, Debug, Serialize)]
pub struct SweepTimes {
    /// Boxes, once for each tube that they lie in.
    pub entries: u32,
    /// Tubes.
    pub tubes: u32,
    /// Passes of the sort.
    pub passes: u32,
    /// Tests.
    pub tested: u64,
    /// By [`Part`], µs.
    pub parts_us: [f64; Part::ALL.len()],
    /// In all, µs.
    pub all_us: f64,
}

/// What another engine took.
#[derive(Clone, Debug, Serialize)]
pub struct Other {
    /// Tests.
    pub tested: u64,
    /// In all, µs.
    pub all_us: f64,
}

/// A scene.
#[derive(Clone, Debug, Serialize)]
pub struct SweepRow {
    /// The scene.
    pub scene: String,
    /// Boxes.
    pub n: u32,
    /// Pairs, which all engines found.
    pub pairs: u64,
    /// The sweep; nothing where it refused.
    pub sweep: Option<SweepTimes>,
    /// `gpu-grid`; nothing where it refused.
    pub grid: Option<Other>,
    /// `gpu-brute`; nothing where it took no part.
    pub all_pairs: Option<Other>,
}

impl SweepRow {
    /// How many times as long the sweep took as the faster of the other two; nothing where one side has no figure.
    pub fn ratio(&self) -> Option<f64> {
        let others = [&self.grid, &self.all_pairs];
        let best = others.into_iter().flatten().map(|other| other.all_us).reduce(f64::min)?;
        Some(self.sweep.as_ref()?.all_us / best)
    }

    /// Whether the sweep is the fastest engine of the GPU here.
    pub fn is_won(&self) -> bool {
        self.sweep.is_some() && self.ratio().is_none_or(|ratio| ratio < 1.0)
    }
}

/// The figures of a study.
#[derive(Clone, Debug, Serialize)]
pub struct SweepReport {
    /// The machine of the study.
    pub machine: Machine,
    /// Scenes.
    pub rows: Vec<SweepRow>,
}

/// Measures, writes the files that the options ask for, and prints the report to `print`.
///
/// # Errors
/// [`SweepStudyError`].
pub fn run_and_print(
    options: &SweepOptions,
    print: &mut dyn io::Write,
) -> Result<SweepReport, SweepStudyError> {
    let gpu = Gpu::open(&options.gpu, HostImport::IfPossible)?;
    let budget = Duration::from_millis(if options.quick { 10 } else { 300 });
    let report = measure::measure(&gpu, &options.counts, budget)?;
    let json = serde_json::to_string_pretty(&report)?;
    let text = markdown(&report);
    if let Some(folder) = &options.out {
        let written = std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(folder.join("sweep.json"), format!("{json}\n")))
            .and_then(|()| std::fs::write(folder.join("sweep.md"), &text));
        written.map_err(|error| SweepStudyError::Write { folder: folder.clone(), error })?;
    }
    if options.json { writeln!(print, "{json}") } else { write!(print, "{text}") }?;
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sweep_wins_against_the_faster_of_the_others_or_where_both_refuse() {
        let other = |all_us| Some(Other { tested: 1, all_us });
        let times = SweepTimes {
            entries: 1,
            tubes: 1,
            passes: 1,
            tested: 1,
            parts_us: [1.0; 4],
            all_us: 4.0,
        };
        let row = |sweep, grid, all_pairs| SweepRow {
            scene: String::new(),
            n: 1,
            pairs: 0,
            sweep,
            grid,
            all_pairs,
        };
        let won = |sweep, grid, all_pairs| row(sweep, grid, all_pairs).is_won();
        assert!(won(Some(times.clone()), other(8.0), None));
        assert!(!won(Some(times.clone()), other(8.0), other(2.0)));
        assert!(won(Some(times.clone()), None, None));
        assert!(!won(None, None, other(2.0)));
        assert_eq!(row(Some(times), other(8.0), other(2.0)).ratio(), Some(2.0));
    }
}
