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
mod scenes;
pub mod stage;

use std::time::Duration;

use pairmaskd::execute::gpu::{Gpu, GpuChoice, HostImport};
use serde::Serialize;

pub use self::device::{GpuSweep, SweepError, Swept};
pub use self::plan::SweepPlan;
pub use self::scenes::SweepScene;
use super::harness::document;
use super::harness::machine::Machine;
use super::harness::table::Table;
use super::harness::{Report, StudyError};

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

/// Measures all scenes of these numbers of boxes; with `quick` short runs, for a look.
///
/// # Errors
/// [`StudyError`].
pub fn measure(choice: &GpuChoice, counts: &[u32], quick: bool) -> Result<SweepReport, StudyError> {
    let gpu = Gpu::open(choice, HostImport::IfPossible)?;
    let budget = Duration::from_millis(if quick { 10 } else { 300 });
    measure::measure(&gpu, counts, budget)
}

impl Report for SweepReport {
    const NAME: &'static str = "sweep";

    fn parts(&self) -> Vec<document::Part> {
        let mut table = Table::of(&self.rows);
        table.head.push("ratio".to_owned());
        for (line, row) in table.rows.iter_mut().zip(&self.rows) {
            line.push(row.ratio().into());
        }
        let won = self.rows.iter().filter(|row| row.is_won());
        let won: Vec<String> = won.map(|row| format!("{} {}", row.scene, row.n)).collect();
        let won =
            if won.is_empty() { "nowhere".to_owned() } else { format!("in: {}", won.join(", ")) };
        let mut parts = vec![document::Part::heading(1, "Sweep and prune on the GPU")];
        parts.extend(self.machine.parts());
        parts.push(document::Part::text(
            "GPU's clock, medians, µs, transfers included: boxes in host memory, a list of pairs in host \
             memory. Every engine's pairs are those of the cores' grid; empty where it refused or took no \
             part. `parts_us` are transfers, keys, sort and pairs. Ratio: the sweep's time by that of the \
             faster engine.",
        ));
        parts.push(document::Part::Table(table));
        parts.push(document::Part::text(format!("The sweep is the fastest {won}.")));
        parts
    }

    fn tables(&self) -> Vec<(&'static str, Table)> {
        vec![("rows", Table::of(&self.rows))]
    }
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
