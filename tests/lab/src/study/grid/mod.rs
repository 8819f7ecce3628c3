//! The grid study: the cost of the grid, stage by stage, and the sizes from which on it pays.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments
//! using GPU mapping function", EGPGV 2012, §4 to §6: tables 6 and 7, figures 5 and 6, measured
//! there on an NVIDIA Quadro FX 3600M. Boxes lie in shared memory, the mask comes back there; no
//! daemon is between.

mod floor;
mod measure;
mod report;

use std::io;
use std::path::PathBuf;

use serde::Serialize;

pub use self::floor::{Bandwidth, StageRow};
pub use self::measure::{PAPER_PARTS, PAPER_WITHOUT, paper_frame_ms};
pub use self::report::markdown;
use pairmaskd::execute::gpu::{Gpu, GpuChoice, GpuError, HostImport, OpenError};
use pairmaskd::file_error::{Access, advice};

use super::machine::Machine;
use crate::gpu_stages::BenchError;
use crate::gpu_stages::grid::GridRow;

/// Options of the study.
#[derive(Clone, Debug, Default)]
pub struct GridOptions {
    /// The GPU.
    pub gpu: GpuChoice,
    /// Numbers of boxes of table 6, figure 5 and the stages.
    pub counts: Vec<u32>,
    /// Short runs of small scenes, in seconds. Times mean little.
    pub quick: bool,
    /// Folder for `grid.json` and `grid.md`; made if it is not there.
    pub out: Option<PathBuf>,
    /// Print JSON in place of Markdown.
    pub json: bool,
}

/// Why the study failed.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The GPU that was asked for does not exist.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The GPU failed on the way.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame failed, or had other pairs than the CPU's.
    #[error(transparent)]
    Bench(#[from] BenchError),
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

/// All figures of a study. Fields that begin with `paper_` are the paper's.
#[derive(Clone, Debug, Serialize)]
pub struct GridReport {
    /// The machine of the study.
    pub machine: Machine,
    /// The device's highest bandwidths.
    pub bandwidth: Bandwidth,
    /// Scenes in motion: stages and whole frames, every first and last mask compared with the CPU's.
    pub scenes: Vec<GridRow>,
    /// GPU time by stage beside the lower bound by its memory traffic.
    pub stages: Vec<StageRow>,
    /// Table 6.
    pub parts: Vec<PartsRow>,
    /// Table 7.
    pub with_and_without: Vec<WithoutRow>,
    /// Fewest boxes, of the measured sizes, from which on the grid is faster than all pairs.
    pub crossing: Option<u32>,
    /// Figure 5.
    pub engines: Vec<EnginesRow>,
    /// Figure 6.
    pub moving: Vec<MovingRow>,
    /// Frames a second with one and with two frames under way.
    pub under_way: Vec<UnderWayRow>,
}

/// Table 6: update of the boxes (α), of the grid (β), overlapping pairs (δ). Milliseconds.
#[derive(Clone, Debug, Serialize)]
pub struct PartsRow {
    /// Boxes.
    pub n: u32,
    /// Boxes from transforms, on all threads of the CPU.
    pub update_boxes_ms: f64,
    /// Upload, cells, order: by the GPU's clock.
    pub update_grid_ms: f64,
    /// Pairs and download: by the GPU's clock.
    pub cull_ms: f64,
    /// Boxes updated → mask in shared memory, by the host's clock.
    pub total_ms: f64,
    /// α, β, δ and total of the paper.
    pub paper_ms: Option<[f64; 4]>,
}

/// Table 7: all pairs against the grid. Milliseconds a frame.
#[derive(Clone, Debug, Serialize)]
pub struct WithoutRow {
    /// Boxes.
    pub n: u32,
    /// All pairs.
    pub without_ms: f64,
    /// Grid.
    pub with_ms: f64,
    /// The paper's: without, with.
    pub paper_ms: Option<[f64; 2]>,
}

/// Figure 5: engines by the number of boxes. Milliseconds a frame.
#[derive(Clone, Debug, Serialize)]
pub struct EnginesRow {
    /// Boxes.
    pub n: u32,
    /// The grid on the GPU.
    pub gpu_grid_ms: f64,
    /// The grid on all threads of the CPU.
    pub cpu_grid_ms: f64,
    /// Sweep and prune on all threads of the CPU; not where it takes seconds.
    pub cpu_sap_ms: Option<f64>,
    /// The paper's grid on its GPU.
    pub paper_ms: Option<f64>,
}

/// Figure 6: time by the share of boxes that move.
#[derive(Clone, Debug, Serialize)]
pub struct MovingRow {
    /// Boxes.
    pub n: u32,
    /// Of a hundred boxes.
    pub moving_percent: u32,
    /// Milliseconds a frame.
    pub frame_ms: f64,
}

/// Gain of a second frame under way: the boxes of one cross the link up while the other's mask
/// comes down.
#[derive(Clone, Debug, Serialize)]
pub struct UnderWayRow {
    /// Boxes of the uniform scene.
    pub n: u32,
    /// Frames a second, one at a time.
    pub one_fps: f64,
    /// Frames a second, two at a time.
    pub two_fps: f64,
}

/// Measures, writes the files that the options ask for, and prints the report to `print`.
///
/// # Errors
/// [`GridError`].
pub fn run_and_print(
    options: &GridOptions,
    print: &mut dyn io::Write,
) -> Result<GridReport, GridError> {
    let report = measure(options)?;
    let json = serde_json::to_string_pretty(&report)?;
    let text = markdown(&report);
    if let Some(folder) = &options.out {
        let written = std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(folder.join("grid.json"), format!("{json}\n")))
            .and_then(|()| std::fs::write(folder.join("grid.md"), &text));
        written.map_err(|error| GridError::Write { folder: folder.clone(), error })?;
    }
    if options.json { writeln!(print, "{json}") } else { write!(print, "{text}") }?;
    Ok(report)
}

/// Measures and writes nothing.
///
/// # Errors
/// [`GridError`].
pub fn measure(options: &GridOptions) -> Result<GridReport, GridError> {
    let gpu = Gpu::open(&options.gpu, HostImport::IfPossible)?;
    measure::measure(&gpu, options)
}

/// As [`run_and_print`], to the standard output.
///
/// # Errors
/// [`GridError`].
pub fn run(options: &GridOptions) -> Result<GridReport, GridError> {
    run_and_print(options, &mut io::stdout().lock())
}
