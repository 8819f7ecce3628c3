//! `cull --explain`: why the plan chose the engine, and how well it predicted the time.

use std::fmt;
use std::time::Duration;

use pairmask::{PairMask, ServedBy};
use pairmask_core::Aabb;
use pairmask_core::dispatch::{CpuEngines, CullOptions};
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Plan, SceneStats};
use serde::Serialize;

use crate::cli::output::time_text;

/// A second plan of the same frame, made for the report.
pub struct Planned {
    plan: Plan,
    calibration: String,
}

impl Planned {
    /// Plans a frame as an in-process session does, and a daemon without a GPU.
    pub fn new(boxes: &[Aabb], options: &CullOptions, isa: AvailableIsa) -> Self {
        let calibration = Calibration::built_in(isa.get());
        let plan = CpuEngines::on(isa, calibration).plan(boxes, options, None);
        Self { plan, calibration: format!("built in for {}", isa.get()) }
    }
}

/// The object `explain` of `cull --json --explain`. Fields may be added, never changed or taken
/// away.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// The plan's statistics of the boxes.
    stats: Stats,
    /// Origin of the cost model's constants.
    calibration: String,
    /// Every engine that was considered, with its best encoding and number of threads.
    candidates: Vec<Candidate>,
    /// The engine that was chosen.
    engine: &'static str,
    encoding: &'static str,
    threads: usize,
    why: &'static str,
    /// Predicted time of the chosen engine, ns; null where this process does not have the engine.
    predicted_ns: Option<u64>,
    /// Measured time of engine and decode, without planning, ns.
    measured_ns: u64,
    /// What this process cannot know about the answer, if anything.
    note: Option<String>,
    #[serde(skip)]
    text: String,
}

#[derive(Clone, Debug, Serialize)]
struct Stats {
    boxes: u32,
    /// False for so few boxes that measuring them costs more than it gains: the other figures are
    /// then assumed.
    looked_at: bool,
    solid_share: f32,
    median_size: f32,
    large_size: f32,
    window_share: f32,
    elongation: f32,
    expected_pairs: u64,
}

#[derive(Clone, Debug, Serialize)]
struct Candidate {
    engine: &'static str,
    encoding: &'static str,
    threads: usize,
    predicted_ns: u64,
}

impl Explanation {
    /// The explanation of an answered frame.
    pub fn new(planned: &Planned, mask: &PairMask, decode: Duration) -> Self {
        let Planned { plan, calibration } = planned;
        let info = mask.info();
        let candidates: Vec<_> = plan.candidates.iter().flatten().collect();
        let chosen = candidates.iter().find(|c| c.engine == plan.engine);
        let note = (info.served_by == ServedBy::Daemon).then(|| {
            format!(
                "the daemon took {}; planned here, with this process's constants and without a GPU: \
                 what a daemon plans, it logs with PAIRMASK_LOG=debug",
                info.engine
            )
        });
        Self {
            stats: Stats::new(&plan.stats),
            calibration: calibration.clone(),
            candidates: candidates
                .iter()
                .map(|c| Candidate {
                    engine: c.engine.as_str(),
                    encoding: c.encoding.as_str(),
                    threads: c.threads,
                    predicted_ns: c.predicted_ns as u64,
                })
                .collect(),
            engine: plan.engine.as_str(),
            encoding: plan.encoding.as_str(),
            threads: plan.threads,
            why: plan.why(),
            predicted_ns: chosen.map(|c| c.predicted_ns as u64),
            measured_ns: info.times.total_ns.saturating_sub(info.times.plan_ns)
                + decode.as_nanos() as u64,
            note,
            text: plan.explain().to_string(),
        }
    }
}

impl Stats {
    fn new(stats: &SceneStats) -> Self {
        Self {
            boxes: stats.n.get(),
            looked_at: stats.is_looked_at,
            solid_share: stats.solid_share,
            median_size: stats.median_size,
            large_size: stats.large_size,
            window_share: stats.window_share,
            elongation: stats.elongation,
            expected_pairs: stats.expected_pairs() as u64,
        }
    }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.text)?;
        writeln!(f, "constants  {}", self.calibration)?;
        if let Some(ns) = self.predicted_ns {
            writeln!(f, "predicted  {}", time_text(ns))?;
        }
        write!(
            f,
            "measured   {} (engine and decode; a first frame is cold)",
            time_text(self.measured_ns)
        )?;
        if let Some(note) = &self.note {
            write!(f, "\nnote       {note}")?;
        }
        Ok(())
    }
}
