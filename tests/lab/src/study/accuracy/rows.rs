//! The figures of the accuracy study, as written to JSON and read back for comparison.
//!
//! Fields may be added, never changed or taken away. Times are integers, nanoseconds.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::judge::Pareto;
use super::truth::Difference;
use super::variants::VariantRow;
use crate::study::harness::machine::Machine;

/// The results of one run of the study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AccuracyReport {
    /// The machine, and the command line.
    pub machine: Machine,
    /// Seed of the scenes.
    pub seed: u64,
    /// One for every scene, n, mode and engine.
    pub rows: Vec<AccuracyRow>,
    /// Which modes are worth having, by the rows. Absent in reports of earlier versions.
    #[serde(default)]
    pub pareto: Pareto,
    /// One for every way to turn a pair's number into the pair, n and processor. None of these ways
    /// serves a client. Absent in reports of earlier versions.
    #[serde(default)]
    pub variants: Vec<VariantRow>,
}

impl AccuracyReport {
    /// A report of rows, with what follows from them.
    pub fn new(
        machine: Machine,
        seed: u64,
        rows: Vec<AccuracyRow>,
        variants: Vec<VariantRow>,
    ) -> Self {
        let pareto = Pareto::of(&rows);
        Self { machine, seed, rows, pareto, variants }
    }
}

/// Percentiles of a time, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Half of the frames took no longer.
    pub p50: u64,
    /// All but one frame in a hundred took no longer.
    pub p99: u64,
}

impl Percentiles {
    /// By nearest rank: each is a measured time.
    pub fn of(mut times: Vec<u64>) -> Self {
        times.sort_unstable();
        let at = |percent: usize| {
            let rank = (times.len() * percent).div_ceil(100);
            times.get(rank.saturating_sub(1)).copied().unwrap_or_default()
        };
        Self { p50: at(50), p99: at(99) }
    }
}

/// Stages of a frame. `round_trip` holds `engine`, which holds `ingest`, `plan`, `execute` and `publish`; `total` is
/// `fill` (memory borrowed, boxes written), `round_trip` and `decode` (every pair of the mask visited once).
/// Percentiles do not add up; stages of one frame do.
pub const STAGES: [&str; 9] = [
    "fill_ns",
    "ingest_ns",
    "plan_ns",
    "execute_ns",
    "publish_ns",
    "engine_ns",
    "round_trip_ns",
    "decode_ns",
    "total_ns",
];

/// One scene of n boxes in motion, culled in one mode by one engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AccuracyRow {
    /// Name of the scene.
    pub scene: String,
    /// Boxes.
    pub n: u32,
    /// The mode: `exact`, `q16`, `q8`, `f16`, `margin`, `f64`, `plain-f32` or `spheres`.
    pub mode: String,
    /// Of the mode `margin`: how far boxes are inflated, in units of the scene; else null.
    pub margin: Option<f64>,
    /// Of the modes `f64` and `plain-f32`: how far from the origin the scene lies, in units; else
    /// null.
    pub offset: Option<f64>,
    /// Of the mode `spheres`: `circumscribed` or `inscribed`; else null.
    pub spheres: Option<String>,
    /// Where the pairs were found: `daemon` or `in-process`.
    pub backend: String,
    /// The engine that was asked for, `auto` where the plan chose.
    pub engine: String,
    /// The engine that answered the last frame.
    pub served_by_engine: String,
    /// Frames that were timed.
    pub frames: u64,
    /// Frames for which a request was made; the others were answered by a kept mask.
    pub requests: u64,
    /// Times of [`STAGES`] over all timed frames, those without a request included.
    pub times: BTreeMap<String, Percentiles>,
    /// Bytes of the boxes of one request.
    pub bytes_up: u64,
    /// Bytes of the mask of one request, the mean over all of them.
    pub bytes_down: u64,
    /// Frames whose pairs were compared with the exact ones.
    pub checked_frames: u64,
    /// Exact pairs in those frames: of the boxes; of `f64` and `plain-f32` the boxes in f64; of
    /// `spheres` the spheres.
    pub true_pairs: u64,
    /// Exact pairs that were not reported. Anything but 0 disqualifies the mode.
    pub missed: u64,
    /// Reported pairs that are not exact ones.
    pub extra: u64,
    /// `extra / true_pairs`, 0 where both are 0; null where only `true_pairs` is.
    pub extra_ratio: Option<f64>,
    /// Of the mode `spheres`: the same frames against the pairs of the scene's boxes; else null.
    pub against_boxes: Option<AgainstBoxes>,
    /// Resident memory of client and daemon together at the end of the row, bytes.
    pub memory_bytes: u64,
}

/// Pairs of objects that stand for boxes, against the boxes' pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgainstBoxes {
    /// The boxes' pairs.
    pub true_pairs: u64,
    /// Pairs of the boxes that were not reported.
    pub missed: u64,
    /// Reported pairs that are not the boxes'.
    pub extra: u64,
    /// `extra / true_pairs`, as in [`AccuracyRow::extra_ratio`].
    pub extra_ratio: Option<f64>,
}

impl From<Difference> for AgainstBoxes {
    fn from(Difference { true_pairs, missed, extra }: Difference) -> Self {
        Self { true_pairs, missed, extra, extra_ratio: AccuracyRow::ratio(extra, true_pairs) }
    }
}

impl AccuracyRow {
    /// Times of a stage; zeros where a report of another version has none.
    pub fn time(&self, stage: &str) -> Percentiles {
        self.times.get(stage).copied().unwrap_or_default()
    }

    /// Median of the whole frame, ns.
    pub fn p50(&self) -> u64 {
        self.time("total_ns").p50
    }

    /// The key by which rows of two reports are matched.
    pub fn key(&self) -> (&str, u32, String, &str, &str) {
        (&self.scene, self.n, self.mode_text(), &self.backend, &self.engine)
    }

    /// The mode as the command line has it.
    pub fn mode_text(&self) -> String {
        let mode = &self.mode;
        match (self.margin, self.offset, &self.spheres) {
            (Some(margin), _, _) => format!("{mode}={margin}"),
            (None, Some(offset), _) => format!("{mode}={offset:e}"),
            (None, None, Some(fit)) => format!("{mode}={fit}"),
            (None, None, None) => mode.clone(),
        }
    }

    /// Extra pairs for each true one, for a user who wants the pairs of the boxes: spheres are
    /// compared with the boxes' pairs. `None` where a pair was missed, no frame was checked, or
    /// there is no true pair.
    pub fn error(&self) -> Option<f64> {
        let ratio = self.against_boxes.map_or(self.extra_ratio, |boxes| boxes.extra_ratio);
        ratio.filter(|_| self.missed_of_boxes() == 0 && self.checked_frames > 0)
    }

    /// Pairs missed, those of the boxes that spheres stand for included.
    pub fn missed_of_boxes(&self) -> u64 {
        self.missed + self.against_boxes.map_or(0, |boxes| boxes.missed)
    }

    /// Name of the row, for messages.
    pub fn name(&self) -> String {
        let Self { scene, n, backend, engine, .. } = self;
        format!("{scene} {n} {} {backend} {engine}", self.mode_text())
    }

    /// `extra / true_pairs` where that is a number.
    pub fn ratio(extra: u64, true_pairs: u64) -> Option<f64> {
        match (extra, true_pairs) {
            (0, _) => Some(0.0),
            (_, 0) => None,
            _ => Some(extra as f64 / true_pairs as f64),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A row with a number everywhere.
    pub fn row() -> AccuracyRow {
        AccuracyRow {
            scene: "uniform".to_owned(),
            n: 1000,
            mode: "margin".to_owned(),
            margin: Some(0.1),
            offset: None,
            spheres: None,
            backend: "daemon".to_owned(),
            engine: "auto".to_owned(),
            served_by_engine: "cpu-grid".to_owned(),
            frames: 200,
            requests: 40,
            times: totals(500_000, 1_500_000),
            bytes_up: 24_000,
            bytes_down: 12_000,
            checked_frames: 4,
            true_pairs: 4000,
            missed: 0,
            extra: 100,
            extra_ratio: AccuracyRow::ratio(100, 4000),
            against_boxes: None,
            memory_bytes: 1 << 30,
        }
    }

    /// A row of a mode without a number, of 1,000 true pairs.
    pub fn of_mode(mode: &str, p50: u64, extra: u64, missed: u64) -> AccuracyRow {
        AccuracyRow {
            mode: mode.to_owned(),
            margin: None,
            times: totals(p50, 2 * p50),
            true_pairs: 1000,
            missed,
            extra,
            extra_ratio: AccuracyRow::ratio(extra, 1000),
            ..row()
        }
    }

    pub fn totals(p50: u64, p99: u64) -> BTreeMap<String, Percentiles> {
        let stage = |stage: &str| {
            let times = Percentiles { p50, p99 };
            (stage.to_owned(), if stage == "total_ns" { times } else { Percentiles::default() })
        };
        STAGES.map(stage).into()
    }

    pub fn report(rows: Vec<AccuracyRow>) -> AccuracyReport {
        AccuracyReport::new(Machine::here(None), 1, rows, Vec::new())
    }

    #[test]
    fn a_report_survives_json_and_one_of_an_earlier_version_is_read()
    -> Result<(), serde_json::Error> {
        let report = report(vec![row()]);
        let mut json = serde_json::to_value(&report)?;
        assert_eq!(serde_json::from_value::<AccuracyReport>(json.clone())?, report);
        for field in ["pareto", "variants"] {
            json.as_object_mut().map(|report| report.remove(field));
        }
        for field in ["offset", "spheres", "against_boxes"] {
            json["rows"][0].as_object_mut().map(|row| row.remove(field));
        }
        assert_eq!(serde_json::from_value::<AccuracyReport>(json)?.rows, [row()]);
        Ok(())
    }

    #[test]
    fn spheres_are_judged_by_the_boxes_and_a_missed_pair_by_nothing() {
        let boxes = AgainstBoxes { true_pairs: 10, missed: 0, extra: 5, extra_ratio: Some(0.5) };
        assert_eq!(row().error(), Some(0.025));
        let with = |against_boxes| AccuracyRow { against_boxes, ..row() }.error();
        assert_eq!(with(Some(boxes)), Some(0.5));
        assert_eq!(with(Some(AgainstBoxes { missed: 1, ..boxes })), None);
        assert_eq!(AccuracyRow { missed: 1, ..row() }.error(), None);
        assert_eq!(AccuracyRow { checked_frames: 0, ..row() }.error(), None);
        assert_eq!(
            [(0, 0), (1, 0), (1, 4)].map(|(extra, of)| AccuracyRow::ratio(extra, of)),
            [Some(0.0), None, Some(0.25)]
        );
    }

    #[test]
    fn percentiles_are_measured_times() {
        assert_eq!(Percentiles::of(vec![]), Percentiles::default());
        assert_eq!(Percentiles::of(vec![7]), Percentiles { p50: 7, p99: 7 });
        let hundred: Vec<u64> = (1..=100).rev().collect();
        assert_eq!(Percentiles::of(hundred), Percentiles { p50: 50, p99: 99 });
    }
}
