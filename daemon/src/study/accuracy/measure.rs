//! One row: a scene in motion, culled in one mode.

use std::time::Duration;

use pairmask::{EngineChoice, EngineName, PairMask, Session};

use super::rows::{AccuracyRow, Percentiles, StageTimes};
use super::truth::{self, Difference};
use crate::precision::PrecisionChoice;
use crate::scene::{Scene, SceneName};
use crate::timed_client::{TimedClient, TimedError, TimedFrame};

/// What a row is about.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// The scene.
    pub scene: SceneName,
    /// Boxes.
    pub n: u32,
    /// The mode.
    pub precision: PrecisionChoice,
    /// The engine that is asked for.
    pub engine: EngineChoice,
    /// Seed of the scene.
    pub seed: u64,
}

/// How many frames.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Before anything is recorded.
    pub warm_up: u32,
    /// Recorded.
    pub frames: u32,
    /// Of those, how many are checked against the truth: the first, and others at even intervals.
    pub checked: u32,
}

impl Lengths {
    fn is_checked(&self, frame: u32) -> bool {
        let interval = self.frames.div_ceil(self.checked.max(1)).max(1);
        self.checked > 0 && frame.is_multiple_of(interval)
    }
}

/// Runs a row in a session that asks for the subject's engine.
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
    let mut client = TimedClient::new(session, subject.precision, scene.boxes());
    let mut last = client.frame(scene.boxes(), |_| ())?;
    for _ in 0..lengths.warm_up {
        scene.step();
        last = client.frame(scene.boxes(), |_| ())?;
    }
    let mut record = Record::default();
    let (mut found, mut checked_frames) = (Difference::default(), 0);
    for frame in 0..lengths.frames {
        scene.step();
        let mut reported = None;
        let is_checked = lengths.is_checked(frame);
        let look = |mask: &PairMask| reported = is_checked.then(|| mask.to_vec());
        last = client.frame(scene.boxes(), look)?;
        record.add(&last);
        if let Some(mut reported) = reported {
            reported.sort_unstable();
            let truth = truth::pairs(scene.boxes(), last.info.engine)?;
            found.add(&Difference::between(&reported, &truth));
            checked_frames += 1;
        }
    }
    let margin = match subject.precision {
        // The number as people write it: 0.1, and not the f64 that an f32 of 0.1 is.
        PrecisionChoice::Margin(margin) => margin.get().to_string().parse().ok(),
        _ => None,
    };
    Ok(AccuracyRow {
        scene: subject.scene.to_string(),
        n: subject.n,
        mode: subject.precision.mode().to_owned(),
        margin,
        backend: last.info.served_by.as_str().to_owned(),
        engine: subject.engine.to_string(),
        served_by_engine: last.info.engine.to_string(),
        frames: u64::from(lengths.frames),
        requests: record.requests,
        times: record.times(),
        bytes_up: last.info.box_bytes,
        bytes_down: record.mask_bytes.checked_div(record.requests).unwrap_or(last.info.mask_bytes),
        checked_frames,
        true_pairs: found.true_pairs,
        missed: found.missed,
        extra: found.extra,
        extra_ratio: AccuracyRow::ratio(found.extra, found.true_pairs),
        memory_bytes: memory_bytes(),
    })
}

/// Whether an engine can take a scene of so many boxes in reasonable time.
pub fn is_reasonable(subject: &Subject) -> bool {
    let is_brute = subject.engine == EngineChoice::Only(EngineName::CpuBrute);
    let limit = if is_brute || subject.scene.is_quadratic() { BRUTE_LIMIT } else { u32::MAX };
    subject.n <= limit
}

/// Most boxes that are compared each with each on a CPU: 5·10⁸ tests, some 0.1 s a frame.
const BRUTE_LIMIT: u32 = 32_768;

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
    fn add(&mut self, frame: &TimedFrame) {
        let ns = |time: Duration| time.as_nanos() as u64;
        let asked = u64::from(frame.was_asked);
        let times = &frame.info.times;
        self.requests += asked;
        self.mask_bytes += asked * frame.info.mask_bytes;
        self.fill.push(ns(frame.fill));
        self.ingest.push(asked * times.ingest_ns);
        self.plan.push(asked * times.plan_ns);
        self.execute.push(asked * times.execute_ns);
        self.publish.push(asked * times.publish_ns);
        self.engine.push(frame.engine_ns());
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

/// By nearest rank: a time that was measured, not one between two.
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

    #[test]
    fn rows_of_every_mode_miss_nothing() {
        let lengths = Lengths { warm_up: 1, frames: 10, checked: 5 };
        for mode in ["exact", "q16", "q8", "f16", "margin=0.1"] {
            let session = Session::builder().backend(Backend::InProcess).connect();
            let subject = Subject {
                scene: SceneName::Pile,
                n: 345,
                precision: mode.parse().unwrap_or_default(),
                engine: EngineChoice::Auto,
                seed: 1,
            };
            let row = session.map(|s| row(s, &subject, &lengths, || 7));
            let Ok(Ok(row)) = row else { panic!("{mode}: {row:?}") };
            assert_eq!((row.frames, row.checked_frames, row.missed), (10, 5, 0), "{mode}");
            assert!(mode.starts_with(&row.mode) && row.true_pairs > 0 && row.memory_bytes == 7);
            assert!(mode != "exact" || row.extra == 0, "{row:?}");
            assert!(mode != "q8" || row.extra > 0, "{row:?}");
            assert_eq!(row.requests < 10, row.margin.is_some(), "{row:?}");
            assert!(row.times.total_ns.p50 > 0 && row.bytes_up > 0 && row.bytes_down > 0);
        }
    }
}
