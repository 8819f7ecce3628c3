//! One row: a scene in motion, culled in one mode.

use std::time::Duration;

use pairmask::Session;
use pairmask_core::dispatch::CullOptions;
use pairmask_core::{EngineChoice, EngineName};
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::timed_client::TimedError;

use super::contender::{FrameFigures, contender};
use super::mode::{Rounding, StudyMode, World};
use super::rows::{AccuracyRow, AgainstBoxes, Percentiles, StageTimes};
use super::truth::{self, Difference};

/// The subject of a row.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// The scene.
    pub scene: SceneName,
    /// Boxes.
    pub n: u32,
    /// The mode.
    pub mode: StudyMode,
    /// The engine, encoding and threads that are asked for.
    pub options: CullOptions,
    /// Seed of the scene.
    pub seed: u64,
}

/// Numbers of frames.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Frames before the first recorded one.
    pub warm_up: u32,
    /// Recorded frames.
    pub frames: u32,
    /// Recorded frames that are checked against the truth: the first, and others at even intervals.
    pub checked: u32,
}

impl Lengths {
    fn is_checked(&self, frame: u32) -> bool {
        let interval = self.frames.div_ceil(self.checked.max(1)).max(1);
        self.checked > 0 && frame.is_multiple_of(interval)
    }
}

/// Runs a row in a session with the subject's choice of engine.
///
/// # Errors
/// [`TimedError`].
pub fn row(
    session: Session,
    subject: &Subject,
    lengths: &Lengths,
    memory_bytes: impl FnOnce() -> u64,
) -> Result<AccuracyRow, TimedError> {
    let mut scene = Scene::new(subject.scene, subject.n as usize, subject.seed);
    let mut contender = contender(subject.mode, &subject.options, session, scene.boxes());
    let mut last = contender.frame(scene.boxes(), false)?.figures;
    for _ in 0..lengths.warm_up {
        scene.step();
        last = contender.frame(scene.boxes(), false)?.figures;
    }
    let mut record = Record::default();
    let (mut found, mut checked_frames) = (Difference::default(), 0);
    let mut of_boxes = contender.stands_for_boxes().then(Difference::default);
    for frame in 0..lengths.frames {
        scene.step();
        let answer = contender.frame(scene.boxes(), lengths.is_checked(frame))?;
        last = answer.figures;
        record.add(&last);
        if let Some(reported) = answer.pairs {
            let truth = contender.truth(scene.boxes(), last.engine)?;
            found.add(&Difference::between(&reported, &truth));
            if let Some(of_boxes) = &mut of_boxes {
                let truth = truth::pairs(scene.boxes(), last.engine)?;
                of_boxes.add(&Difference::between(&reported, &truth));
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
        StudyMode::Spheres(fit) => (None, None, Some(fit.as_str().to_owned())),
    };
    Ok(AccuracyRow {
        scene: subject.scene.to_string(),
        n: subject.n,
        mode: subject.mode.name().to_owned(),
        margin,
        offset,
        spheres,
        backend: last.backend.to_owned(),
        engine: subject.options.engine.to_string(),
        served_by_engine: last.engine.to_string(),
        frames: u64::from(lengths.frames),
        requests: record.requests,
        times: record.times(),
        bytes_up: last.box_bytes,
        bytes_down: record.mask_bytes.checked_div(record.requests).unwrap_or(last.mask_bytes),
        checked_frames,
        true_pairs: found.true_pairs,
        missed: found.missed,
        extra: found.extra,
        extra_ratio: AccuracyRow::ratio(found.extra, found.true_pairs),
        against_boxes: of_boxes.map(|found| AgainstBoxes {
            true_pairs: found.true_pairs,
            missed: found.missed,
            extra: found.extra,
            extra_ratio: AccuracyRow::ratio(found.extra, found.true_pairs),
        }),
        memory_bytes: memory_bytes(),
    })
}

/// Whether an engine can take a subject at all, and in reasonable time.
pub fn is_reasonable(subject: &Subject) -> bool {
    let (engine, mode) = (subject.options.engine, subject.mode);
    // No GPU engine takes spheres.
    let is_able = match engine {
        EngineChoice::Only(name) if name.is_gpu() => !matches!(mode, StudyMode::Spheres(_)),
        EngineChoice::Only(_) | EngineChoice::Auto => true,
    };
    let is_brute = engine == EngineChoice::Only(EngineName::CpuBrute);
    let limit = match mode {
        StudyMode::World(World { rounding: Rounding::Plain, .. }) => PLAIN_LIMIT,
        _ if is_brute || subject.scene.is_quadratic() => BRUTE_LIMIT,
        _ => u32::MAX,
    };
    is_able && subject.n <= limit
}

/// Most boxes that are compared each with each on a CPU: 5·10⁸ tests, some 0.1 s a frame.
const BRUTE_LIMIT: u32 = 32_768;

/// Most boxes of a world that are rounded to the nearest f32: far from the origin nearly all of them
/// overlap, and 5·10⁷ pairs of a checked frame take 400 MB.
const PLAIN_LIMIT: u32 = 10_000;

/// Times of all frames, stage by stage.
#[derive(Default)]
struct Record {
    fill: Vec<u64>,
    ingest: Vec<u64>,
    plan: Vec<u64>,
    execute: Vec<u64>,
    publish: Vec<u64>,
    engine: Vec<u64>,
    round_trip: Vec<u64>,
    decode: Vec<u64>,
    total: Vec<u64>,
    requests: u64,
    mask_bytes: u64,
}

impl Record {
    fn add(&mut self, frame: &FrameFigures) {
        let ns = |time: Duration| time.as_nanos() as u64;
        let asked = u64::from(frame.was_asked);
        self.requests += asked;
        self.mask_bytes += asked * frame.mask_bytes;
        self.fill.push(ns(frame.fill));
        self.ingest.push(frame.stages.ingest_ns);
        self.plan.push(frame.stages.plan_ns);
        self.execute.push(frame.stages.execute_ns);
        self.publish.push(frame.stages.publish_ns);
        self.engine.push(frame.stages.total_ns);
        self.round_trip.push(ns(frame.round_trip));
        self.decode.push(ns(frame.decode));
        self.total.push(ns(frame.fill + frame.round_trip + frame.decode));
    }

    fn times(&mut self) -> StageTimes {
        StageTimes {
            fill_ns: percentiles(&mut self.fill),
            ingest_ns: percentiles(&mut self.ingest),
            plan_ns: percentiles(&mut self.plan),
            execute_ns: percentiles(&mut self.execute),
            publish_ns: percentiles(&mut self.publish),
            engine_ns: percentiles(&mut self.engine),
            round_trip_ns: percentiles(&mut self.round_trip),
            decode_ns: percentiles(&mut self.decode),
            total_ns: percentiles(&mut self.total),
        }
    }
}

/// Percentiles by nearest rank: each is a measured time.
fn percentiles(times: &mut [u64]) -> Percentiles {
    times.sort_unstable();
    let at = |percent: usize| {
        let rank = (times.len() * percent).div_ceil(100);
        times.get(rank.saturating_sub(1)).copied().unwrap_or_default()
    };
    Percentiles { p50: at(50), p99: at(99) }
}

#[cfg(test)]
mod tests {
    use pairmask::Backend;

    use super::*;

    #[test]
    fn percentiles_are_measured_times() {
        assert_eq!(percentiles(&mut []), Percentiles::default());
        assert_eq!(percentiles(&mut [7]), Percentiles { p50: 7, p99: 7 });
        let mut hundred: Vec<u64> = (1..=100).rev().collect();
        assert_eq!(percentiles(&mut hundred), Percentiles { p50: 50, p99: 99 });
    }

    fn subject(n: u32, mode: &str) -> Subject {
        let mode = mode.parse().unwrap_or_else(|e| panic!("{e}"));
        Subject { scene: SceneName::Pile, n, mode, options: CullOptions::default(), seed: 1 }
    }

    #[test]
    fn what_takes_too_long_or_cannot_be_is_left_out() {
        let is_in = |n, mode, engine: &str| {
            let engine = engine.parse().unwrap_or_else(|e| panic!("{e}"));
            let options = CullOptions { engine, ..CullOptions::default() };
            is_reasonable(&Subject { options, ..subject(n, mode) })
        };
        for (n, mode, engine) in [
            (1_000_000, "exact", "cpu-grid"),
            (1_000_000, "f64", "gpu-grid"),
            (1_000_000, "spheres", "auto"),
            (10_000, "plain-f32", "auto"),
            (32_768, "exact", "cpu-brute"),
        ] {
            assert!(is_in(n, mode, engine), "{n} {mode} {engine}");
        }
        for (n, mode, engine) in [
            (32_769, "exact", "cpu-brute"),
            (10_001, "plain-f32", "auto"),
            (10, "spheres", "gpu-grid"),
        ] {
            assert!(!is_in(n, mode, engine), "{n} {mode} {engine}");
        }
    }

    #[test]
    fn rows_of_every_mode_miss_nothing() {
        let lengths = Lengths { warm_up: 1, frames: 10, checked: 5 };
        let modes = ["exact", "q16", "q8", "f16", "margin=0.1", "f64", "spheres", "plain-f32"];
        for mode in modes {
            let session = Session::builder().backend(Backend::InProcess).connect();
            let subject = subject(345, mode);
            let row = session.map(|s| row(s, &subject, &lengths, || 7));
            let Ok(Ok(row)) = row else { panic!("{mode}: {row:?}") };
            assert_eq!((row.frames, row.checked_frames, row.missed), (10, 5, 0), "{mode}");
            assert!(mode.starts_with(&row.mode) && row.true_pairs > 0 && row.memory_bytes == 7);
            assert!(!["exact", "spheres"].contains(&mode) || row.extra == 0, "{row:?}");
            assert!(!["q8", "plain-f32"].contains(&mode) || row.extra > 0, "{row:?}");
            assert_eq!(row.against_boxes.is_some(), mode == "spheres", "{row:?}");
            if let Some(boxes) = &row.against_boxes {
                assert!(boxes.missed == 0 && boxes.extra > 0, "{row:?}");
            }
            assert_eq!(row.requests < 10, row.margin.is_some(), "{row:?}");
            assert!(row.times.total_ns.p50 > 0 && row.bytes_up > 0 && row.bytes_down > 0);
        }
    }
}
