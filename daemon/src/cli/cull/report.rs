//! The report of `cull` on a frame: as text, and as the JSON that `CLI.md` documents.

use std::fmt;
use std::fmt::Write as _;
use std::time::Duration;

use pairmask::{PairMask, ServedBy};
use pairmask_core::dispatch::{CpuEngines, CullOptions};
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Candidate, Plan};
use pairmask_core::{Aabb, Bounds, ObjectForm};
use serde::Serialize;
use serde_json::{Value, json};

use crate::cli::output::time_text;
use crate::cli::skipped::Skipped;
use crate::precision::PrecisionChoice;

/// Times that the command measures itself.
#[derive(Clone, Copy, Debug)]
pub struct Timings {
    pub read: Duration,
    pub round_trip: Duration,
    pub decode: Duration,
    pub total: Duration,
}

/// The JSON object of `cull --json`, whose fields `CLI.md` explains. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, Serialize)]
pub struct CullReport {
    pub shape: &'static str,
    pub boxes: u32,
    pub pairs: u64,
    pub invalid: u32,
    pub empty: u32,
    pub backend: String,
    pub engine: String,
    pub encoding: String,
    pub mask_bytes: u64,
    pub precision: String,
    pub box_form: String,
    pub box_bytes: u64,
    pub gap_below: Option<[f64; 3]>,
    pub stages_ns: StagesNs,
    pub total_ns: u64,
    pub skipped: Skipped,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explain: Option<Explanation>,
    pub warnings: Vec<String>,
}

/// Times of a frame, ns. `round_trip` holds `engine`, which holds the four stages before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct StagesNs {
    pub read: u64,
    pub ingest: u64,
    pub plan: u64,
    pub execute: u64,
    pub publish: u64,
    pub engine: u64,
    pub round_trip: u64,
    pub decode: u64,
}

const fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

impl CullReport {
    pub fn new(
        mask: &PairMask,
        precision: PrecisionChoice,
        world: &Bounds,
        timings: &Timings,
        explain: Option<Explanation>,
        warnings: Vec<String>,
    ) -> Self {
        let info = mask.info();
        let times = &info.times;
        Self {
            shape: match info.form {
                ObjectForm::Boxes(_) => "boxes",
                ObjectForm::Spheres => "spheres",
            },
            boxes: mask.n().get(),
            pairs: mask.count(),
            invalid: info.census.invalid,
            empty: info.census.empty,
            backend: info.served_by.as_str().to_owned(),
            engine: info.engine.to_string(),
            encoding: mask.encoding().to_string(),
            mask_bytes: info.mask_bytes,
            precision: precision.to_string(),
            box_form: info.form.to_string(),
            box_bytes: info.box_bytes,
            gap_below: precision.gap_below(&info.widening, world),
            stages_ns: StagesNs {
                read: ns(timings.read),
                ingest: times.ingest_ns,
                plan: times.plan_ns,
                execute: times.execute_ns,
                publish: times.publish_ns,
                engine: times.total_ns,
                round_trip: ns(timings.round_trip),
                decode: ns(timings.decode),
            },
            total_ns: ns(timings.total),
            skipped: Skipped::from(&info.skipped),
            explain,
            warnings,
        }
    }
}

impl fmt::Display for CullReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shape, boxes, pairs, invalid, empty, stages_ns: stages, skipped, .. } = self;
        writeln!(f, "{shape:<10} {boxes} ({empty} empty, {invalid} invalid)")?;
        writeln!(f, "pairs      {pairs}")?;
        writeln!(f, "engine     {} ({})", self.engine, self.backend)?;
        write!(f, "precision  {}, {} bytes as {}", self.precision, self.box_bytes, self.box_form)?;
        match self.gap_below {
            Some([0.0, 0.0, 0.0]) => writeln!(f),
            Some(gaps) => {
                // The shortest digits of an f32: cells of a small world are far below 0.0001.
                let [x, y, z] = gaps.map(|gap| gap as f32);
                writeln!(f, ", gaps below {x} x {y} x {z} are not seen")
            }
            None => writeln!(f, ", gaps below 1/512 of a coordinate are not seen"),
        }?;
        writeln!(f, "mask       {}, {} bytes", self.encoding, self.mask_bytes)?;
        writeln!(f, "skipped    {skipped}")?;
        for (name, time) in [
            ("read", stages.read),
            ("round trip", stages.round_trip),
            ("  engine", stages.engine),
            ("decode", stages.decode),
        ] {
            writeln!(f, "{name:<10} {}", time_text(time))?;
        }
        write!(f, "{:<10} {}", "total", time_text(self.total_ns))?;
        if let Some(explanation) = &self.explain {
            write!(f, "\n\n{explanation}")?;
        }
        Ok(())
    }
}

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
