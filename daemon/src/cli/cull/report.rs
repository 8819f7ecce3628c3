//! The report of `cull` on a frame: as text, and as the JSON that `CLI.md` documents.

use std::fmt::Write as _;
use std::time::Duration;

use pairmask::{FrameInfo, PairMask, ServedBy};
use pairmask_core::dispatch::{CpuEngines, CullOptions};
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, Candidate, Plan};
use pairmask_core::{Aabb, Bounds, ObjectForm};
use serde_json::json;

use crate::cli::output::time_text;
use crate::cli::skipped::Skipped;
use crate::precision::PrecisionChoice;
use crate::shown::Shown;

#[derive(Clone, Copy, Debug)]
pub struct Timings {
    pub read: Duration,
    pub round_trip: Duration,
    pub decode: Duration,
    pub total: Duration,
}

const fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

pub fn report(
    mask: &PairMask,
    precision: PrecisionChoice,
    world: &Bounds,
    timings: &Timings,
    explain: Option<Shown>,
    warnings: &[String],
) -> Shown {
    let (info, n, pairs) = (mask.info(), mask.n().get(), mask.count());
    let FrameInfo { form, times, served_by, engine, box_bytes, mask_bytes, .. } = info;
    let (invalid, empty) = (info.census.invalid, info.census.empty);
    let (encoding, skipped) = (mask.encoding(), Skipped::from(&info.skipped));
    let gap_below = precision.gap_below(&info.widening, world);
    let shape = match form {
        ObjectForm::Boxes(_) => "boxes",
        ObjectForm::Spheres => "spheres",
    };
    let mut fields = json!({
        "shape": shape,
        "boxes": n,
        "pairs": pairs,
        "invalid": invalid,
        "empty": empty,
        "backend": served_by.as_str(),
        "engine": engine.to_string(),
        "encoding": encoding.to_string(),
        "mask_bytes": mask_bytes,
        "precision": precision.to_string(),
        "box_form": form.to_string(),
        "box_bytes": box_bytes,
        "gap_below": gap_below,
        // `round_trip` holds `engine`, which holds the four stages before it.
        "stages_ns": {
            "read": ns(timings.read),
            "ingest": times.ingest_ns,
            "plan": times.plan_ns,
            "execute": times.execute_ns,
            "publish": times.publish_ns,
            "engine": times.total_ns,
            "round_trip": ns(timings.round_trip),
            "decode": ns(timings.decode),
        },
        "total_ns": ns(timings.total),
        "skipped": skipped,
        "warnings": warnings,
    });
    let gaps = match gap_below {
        Some([0.0, 0.0, 0.0]) => String::new(),
        Some(gaps) => {
            // The shortest digits of an f32: cells of a small world are far below 0.0001.
            let [x, y, z] = gaps.map(|gap| gap as f32);
            format!(", gaps below {x} x {y} x {z} are not seen")
        }
        None => ", gaps below 1/512 of a coordinate are not seen".to_owned(),
    };
    let backend = served_by.as_str();
    let mut text = format!(
        "{shape:<10} {n} ({empty} empty, {invalid} invalid)\n\
         pairs      {pairs}\n\
         engine     {engine} ({backend})\n\
         precision  {precision}, {box_bytes} bytes as {form}{gaps}\n\
         mask       {encoding}, {mask_bytes} bytes\n\
         skipped    {skipped}"
    );
    for (name, ns) in [
        ("read", ns(timings.read)),
        ("round trip", ns(timings.round_trip)),
        ("  engine", times.total_ns),
        ("decode", ns(timings.decode)),
        ("total", ns(timings.total)),
    ] {
        let _ = write!(text, "\n{name:<10} {}", time_text(ns));
    }
    if let Some(explain) = explain {
        let _ = write!(text, "\n\n{explain}");
        fields["explain"] = explain.fields;
    }
    Shown { fields, text }
}

/// A second plan of the same frame, made for the report: as an in-process session plans it, and a daemon without a GPU.
pub fn plan(boxes: &[Aabb], options: &CullOptions, isa: AvailableIsa) -> Plan {
    CpuEngines::on(isa, Calibration::built_in(isa.get())).plan(boxes, options, None)
}

pub fn explanation(plan: &Plan, isa: AvailableIsa, mask: &PairMask, decode: Duration) -> Shown {
    let calibration = format!("built in for {}", isa.get());
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
            "valid_share": stats.valid_share,
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
    Shown { fields, text }
}
