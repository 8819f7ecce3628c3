//! One row: a scene in motion, culled in one mode.

use std::num::NonZeroU32;
use std::time::Duration;

use clap::Args;
use pairmask::Session;
use pairmask_core::dispatch::{CullOptions, StageTimes};
use pairmask_core::{EngineChoice, EngineName};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::timed_client::{TimedError, TimedFrame};

use super::clients::client;
use super::mode::{CIRCUMSCRIBED, StudyMode, World};
use super::rows::{AccuracyRow, Percentiles, STAGES};
use super::truth::{self, Difference};

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

impl Lengths {
    fn is_checked(&self, frame: u32) -> bool {
        let interval = self.frames.get().div_ceil(self.checked.max(1)).max(1);
        self.checked > 0 && frame.is_multiple_of(interval)
    }
}

pub fn row(
    session: Session,
    subject: &Subject,
    lengths: &Lengths,
    memory_bytes: impl FnOnce() -> u64,
) -> Result<AccuracyRow, TimedError> {
    let mut scene = Scene::new(subject.scene, subject.n as usize, subject.seed);
    let mut client = client(subject.mode, &subject.options, session, scene.boxes())?;
    let mut last = client.frame(scene.boxes(), false)?.frame;
    for _ in 0..lengths.warm_up {
        scene.step();
        last = client.frame(scene.boxes(), false)?.frame;
    }
    let mut times: [Vec<u64>; STAGES.len()] = Default::default();
    let (mut requests, mut mask_bytes) = (0, 0);
    let (mut found, mut checked_frames) = (Difference::NONE, 0);
    let mut against_boxes = client.stands_for_boxes().then_some(Difference::NONE);
    for frame in 0..lengths.frames.get() {
        scene.step();
        let answer = client.frame(scene.boxes(), lengths.is_checked(frame))?;
        last = answer.frame;
        for (times, ns) in times.iter_mut().zip(stages(&last)) {
            times.push(ns);
        }
        requests += u64::from(last.was_asked);
        mask_bytes += u64::from(last.was_asked) * last.info.mask_bytes;
        if let Some(reported) = answer.pairs {
            found.add(&Difference::between(
                &reported,
                &client.truth(scene.boxes(), last.info.engine)?,
            ));
            if let Some(against_boxes) = &mut against_boxes {
                let truth = truth::pairs(scene.boxes(), last.info.engine)?;
                against_boxes.add(&Difference::between(&reported, &truth));
            }
            checked_frames += 1;
        }
    }
    let (margin, offset, spheres) = match subject.mode {
        // The shortest number, 0.1, not the f64 value of the f32 0.1.
        StudyMode::Sent(PrecisionChoice::Margin(margin)) => {
            (margin.get().to_string().parse().ok(), None, None)
        }
        StudyMode::Sent(_) => (None, None, None),
        StudyMode::World(world) => (None, Some(world.offset), None),
        StudyMode::Spheres => (None, None, Some(CIRCUMSCRIBED.to_owned())),
    };
    let percentiles = |(stage, times)| (stage, Percentiles::of(times));
    Ok(AccuracyRow {
        scene: subject.scene.to_string(),
        n: subject.n,
        mode: subject.mode.name().to_owned(),
        margin,
        offset,
        spheres,
        backend: last.info.served_by.as_str().to_owned(),
        engine: subject.options.engine.to_string(),
        served_by_engine: last.info.engine.to_string(),
        frames: lengths.frames.get().into(),
        requests,
        times: STAGES.into_iter().zip(times).map(percentiles).collect(),
        bytes_up: last.info.box_bytes,
        bytes_down: mask_bytes.checked_div(requests).unwrap_or(last.info.mask_bytes),
        checked_frames,
        found,
        against_boxes,
        memory_bytes: memory_bytes(),
    })
}

fn stages(frame: &TimedFrame) -> [u64; STAGES.len()] {
    let ns = |time: Duration| time.as_nanos() as u64;
    let engine = if frame.was_asked { frame.info.times } else { StageTimes::default() };
    [
        ns(frame.fill),
        engine.ingest_ns,
        engine.plan_ns,
        engine.execute_ns,
        engine.publish_ns,
        engine.total_ns,
        ns(frame.round_trip),
        ns(frame.decode),
        ns(frame.fill + frame.round_trip + frame.decode),
    ]
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
        StudyMode::World(World { is_plain: true, .. }) => PLAIN_LIMIT,
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
