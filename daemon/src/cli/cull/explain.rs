//! `cull --explain`: why the plan chose the engine, and how well it predicted the time.

use std::fmt::{self, Write as _};
use std::time::Duration;

use pairmask::{PairMask, ServedBy};
use pairmask_core::Aabb;
use pairmask_core::dispatch::{CpuEngines, CullOptions};
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Candidate, Plan};
use serde::Serialize;
use serde_json::{Value, json};

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

/// The object `explain` of `cull --json --explain`, whose fields CLI.md has, and the same as text. Fields may be added,
/// never changed or taken away.
#[derive(Clone, Debug, Serialize)]
#[serde(transparent)]
pub struct Explanation {
    fields: Value,
    #[serde(skip)]
    text: String,
}

impl Explanation {
    /// The explanation of an answered frame.
    pub fn new(planned: &Planned, mask: &PairMask, decode: Duration) -> Self {
        let Planned { plan, calibration } = planned;
        let (info, stats) = (mask.info(), &plan.stats);
        let candidates: Vec<_> = plan.candidates.iter().flatten().collect();
        let chosen = candidates.iter().find(|c| c.engine == plan.engine);
        let predicted_ns = chosen.map(|c| c.predicted_ns as u64);
        // Of engine and decode, without planning.
        let measured_ns =
            info.times.total_ns.saturating_sub(info.times.plan_ns) + decode.as_nanos() as u64;
        // What this process cannot know about the answer.
        let note = (info.served_by == ServedBy::Daemon).then(|| {
            format!(
                "the daemon took {}; planned here, with this process's constants and without a GPU: \
                 what a daemon plans, it logs with PAIRMASK_LOG=debug",
                info.engine
            )
        });
        let candidate = |c: &&Candidate| {
            json!({
                "engine": c.engine.as_str(),
                "encoding": c.encoding.as_str(),
                "threads": c.threads,
                "predicted_ns": c.predicted_ns as u64,
            })
        };
        let fields = json!({
            "stats": {
                "boxes": stats.n.get(),
                "looked_at": stats.is_looked_at,
                "solid_share": stats.solid_share,
                "median_size": stats.median_size,
                "large_size": stats.large_size,
                "window_share": stats.window_share,
                "elongation": stats.elongation,
                "expected_pairs": stats.expected_pairs() as u64,
            },
            "calibration": calibration,
            "candidates": candidates.iter().map(candidate).collect::<Vec<_>>(),
            "engine": plan.engine.as_str(),
            "encoding": plan.encoding.as_str(),
            "threads": plan.threads,
            "why": plan.why(),
            "predicted_ns": predicted_ns,
            "measured_ns": measured_ns,
            "note": note,
        });
        let mut text = format!("{}\nconstants  {calibration}\n", plan.explain());
        if let Some(ns) = predicted_ns {
            let _ = writeln!(text, "predicted  {}", time_text(ns));
        }
        let measured = time_text(measured_ns);
        let _ = write!(text, "measured   {measured} (engine and decode; a first frame is cold)");
        if let Some(note) = note {
            let _ = write!(text, "\nnote       {note}");
        }
        Self { fields, text }
    }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}
