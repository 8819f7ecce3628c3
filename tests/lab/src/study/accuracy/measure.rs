//! One row: a scene in motion, culled in one mode.

use std::collections::BTreeMap;
use std::num::NonZeroU32;

use clap::Args;
use pairmask::Session;
use pairmask_core::dispatch::{CullOptions, StageTimes};
use pairmask_core::{EngineChoice, EngineName};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::timed_client::{TimedError, TimedFrame};

use super::clients::Client;
use super::mode::{CIRCUMSCRIBED, StudyMode};
use super::truth::{self, Difference};
use crate::study::harness::{Fields, fields, percentile, row};

/// A name, and its time in a frame, ns.
type Stage = (&'static str, fn(&TimedFrame) -> u64);

/// Stages of a frame. `round_trip` holds `engine`, which holds `ingest`, `plan`, `execute` and `publish`; `total` is
/// `fill` (memory borrowed, boxes written), `round_trip` and `decode` (every pair of the mask iterated over once).
/// Percentiles do not add up; stages of one frame do.
pub const STAGES: [Stage; 9] = [
    ("fill_ns", |frame| frame.fill.as_nanos() as u64),
    ("ingest_ns", |frame| engine(frame).ingest_ns),
    ("plan_ns", |frame| engine(frame).plan_ns),
    ("execute_ns", |frame| engine(frame).execute_ns),
    ("publish_ns", |frame| engine(frame).publish_ns),
    ("engine_ns", |frame| engine(frame).total_ns),
    ("round_trip_ns", |frame| frame.round_trip.as_nanos() as u64),
    ("decode_ns", |frame| frame.decode.as_nanos() as u64),
    ("total_ns", |frame| (frame.fill + frame.round_trip + frame.decode).as_nanos() as u64),
];

fn engine(frame: &TimedFrame) -> StageTimes {
    if frame.was_asked { frame.info.times } else { StageTimes::default() }
}

#[derive(Clone, Copy, Debug)]
pub struct Subject {
    pub scene: SceneName,
    pub n: u32,
    pub mode: StudyMode,
    pub options: CullOptions,
    pub seed: u64,
}

#[derive(Clone, Copy, Debug, Args)]
pub struct Lengths {
    /// Frames that are timed
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "100")]
    frames: NonZeroU32,
    /// Frames before those
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 10)]
    warm_up: u32,
    /// Timed frames whose pairs are compared with the exact ones, after the clock has stopped
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 4)]
    checked: u32,
}

/// A row of the report, whose fields `README.md` documents.
pub fn row(
    session: Session,
    subject: &Subject,
    lengths: &Lengths,
    memory_bytes: impl FnOnce() -> u64,
) -> Result<Fields, TimedError> {
    let mut scene = Scene::new(subject.scene, subject.n as usize, subject.seed);
    let mut client = Client::new(subject.mode, &subject.options, session, scene.boxes())?;
    let mut last = client.frame(scene.boxes(), false)?.frame;
    for _ in 0..lengths.warm_up {
        scene.step();
        last = client.frame(scene.boxes(), false)?.frame;
    }
    let mut times: [Vec<f64>; STAGES.len()] = Default::default();
    let (mut requests, mut mask_bytes) = (0, 0);
    let (mut found, mut checked_frames) = (Difference::NONE, 0u64);
    let mut against_boxes = matches!(client, Client::Spheres(_)).then_some(Difference::NONE);
    let interval = lengths.frames.get().div_ceil(lengths.checked.max(1)).max(1);
    for frame in 0..lengths.frames.get() {
        let is_checked = lengths.checked > 0 && frame.is_multiple_of(interval);
        scene.step();
        let answer = client.frame(scene.boxes(), is_checked)?;
        last = answer.frame;
        for (times, (_, ns)) in times.iter_mut().zip(STAGES) {
            times.push(ns(&last) as f64);
        }
        requests += u64::from(last.was_asked);
        mask_bytes += u64::from(last.was_asked) * last.info.mask_bytes;
        if let Some(reported) = answer.pairs {
            let truth = client.truth(scene.boxes(), last.info.engine)?;
            found.add(&Difference::between(&reported, &truth));
            if let Some(against_boxes) = &mut against_boxes {
                let truth = truth::pairs(scene.boxes(), last.info.engine)?;
                against_boxes.add(&Difference::between(&reported, &truth));
            }
            checked_frames += 1;
        }
    }
    let (mut margin, mut offset, mut spheres) = (None, None, None);
    match subject.mode {
        // The shortest number, 0.1, not the f64 value of the f32 0.1.
        StudyMode::Sent(PrecisionChoice::Margin(of)) => {
            margin = of.get().to_string().parse::<f64>().ok();
        }
        StudyMode::Sent(_) => {}
        StudyMode::F64(from) | StudyMode::PlainF32(from) => offset = Some(from),
        StudyMode::Spheres => spheres = Some(CIRCUMSCRIBED),
    }
    let percentiles = |((stage, _), times): ((&'static str, _), Vec<f64>)| {
        // Each is a measured time, of whole nanoseconds.
        let at = |percent| percentile(times.clone(), percent) as u64;
        (stage, row!(p50: at(50), p99: at(99)))
    };
    let times: BTreeMap<_, _> = STAGES.into_iter().zip(times).map(percentiles).collect();
    let mut row = row!(
        scene: subject.scene.as_str(),
        n: subject.n,
        mode: subject.mode.name(),
        margin,
        offset,
        spheres,
        precision: subject.mode.to_string(),
        backend: last.info.served_by.as_str(),
        engine: subject.options.engine.to_string(),
        served_by_engine: last.info.engine.to_string(),
        frames: lengths.frames,
        requests,
        times,
        bytes_up: last.info.box_bytes,
        bytes_down: mask_bytes.checked_div(requests).unwrap_or(last.info.mask_bytes),
        checked_frames,
    );
    row.extend(fields(&found));
    row.extend(row!(
        error_percent: error_percent(checked_frames, found, against_boxes),
        against_boxes,
        memory_bytes: memory_bytes(),
    ));
    Ok(row)
}

/// Extra pairs for a hundred true ones, for a user who needs the pairs of the boxes: spheres are compared with the
/// boxes' pairs. `None` where a pair was missed, no frame was checked, or there is no true pair.
pub(super) fn error_percent(
    checked_frames: u64,
    found: Difference,
    against_boxes: Option<Difference>,
) -> Option<f64> {
    let missed = found.missed + against_boxes.map_or(0, |boxes| boxes.missed);
    let ratio = against_boxes.unwrap_or(found).extra_ratio;
    ratio.filter(|_| missed == 0 && checked_frames > 0).map(|ratio| 100.0 * ratio)
}

/// Most boxes that are compared each with each on a CPU: 5·10⁸ tests, some 0.1 s a frame.
const BRUTE_LIMIT: u32 = 32_768;

/// Most boxes of a world that are rounded to the nearest f32: far from the origin nearly all of them
/// overlap, and 5·10⁷ pairs of a checked frame take 400 MB.
const PLAIN_LIMIT: u32 = 10_000;

/// Whether an engine can take a subject at all, and in reasonable time.
pub fn is_reasonable(subject: &Subject) -> bool {
    let (engine, mode) = (subject.options.engine, subject.mode);
    // No GPU engine takes spheres.
    let is_on_gpu = matches!(engine, EngineChoice::Only(name) if name.is_gpu());
    let is_able = !(is_on_gpu && mode == StudyMode::Spheres);
    let is_brute = engine == EngineChoice::Only(EngineName::CpuBrute);
    let limit = match mode {
        StudyMode::PlainF32(_) => PLAIN_LIMIT,
        _ if is_brute || subject.scene.is_quadratic() => BRUTE_LIMIT,
        _ => u32::MAX,
    };
    is_able && subject.n <= limit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subject(n: u32, mode: &str, engine: &str) -> Subject {
        let mode = mode.parse().unwrap_or_else(|e| panic!("{e}"));
        let engine = engine.parse().unwrap_or_else(|e| panic!("{e}"));
        let options = CullOptions { engine, ..CullOptions::default() };
        Subject { scene: SceneName::Pile, n, mode, options, seed: 1 }
    }

    #[test]
    fn spheres_are_judged_by_the_boxes_and_a_missed_pair_by_nothing() {
        let (found, boxes) = (Difference::of(4000, 0, 100), Difference::of(10, 0, 5));
        assert_eq!(error_percent(4, found, None), Some(2.5));
        assert_eq!(error_percent(4, found, Some(boxes)), Some(50.0));
        assert_eq!(error_percent(4, found, Some(Difference { missed: 1, ..boxes })), None);
        assert_eq!(error_percent(4, Difference { missed: 1, ..found }, None), None);
        assert_eq!(error_percent(0, found, None), None);
    }

    #[test]
    fn what_takes_too_long_or_cannot_be_is_left_out() {
        for (n, mode, engine, is_in) in [
            (1_000_000, "exact", "cpu-grid", true),
            (1_000_000, "f64", "gpu-grid", true),
            (1_000_000, "spheres", "auto", true),
            (10_000, "plain-f32", "auto", true),
            (32_768, "exact", "cpu-brute", true),
            (32_769, "exact", "cpu-brute", false),
            (10_001, "plain-f32", "auto", false),
            (10, "spheres", "gpu-grid", false),
        ] {
            assert_eq!(is_reasonable(&subject(n, mode, engine)), is_in, "{n} {mode} {engine}");
        }
    }
}
