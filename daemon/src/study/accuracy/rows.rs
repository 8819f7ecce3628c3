//! The figures of the accuracy study: what is written as JSON and read back to be compared.
//!
//! Fields may be added, never changed or taken away. Times are integers, nanoseconds.

use serde::{Deserialize, Serialize};

use crate::study::machine::Machine;

/// Everything that one run of the study found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AccuracyReport {
    /// What it ran on, and the command line.
    pub machine: Machine,
    /// Seed of the scenes.
    pub seed: u64,
    /// One for every scene, n, mode and engine.
    pub rows: Vec<AccuracyRow>,
}

/// Percentiles of a time, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Half of the frames took no longer.
    pub p50: u64,
    /// All but one frame in a hundred took no longer.
    pub p99: u64,
}

/// Times of a frame by stage.
///
/// `round_trip` holds `engine`, which holds `ingest`, `plan`, `execute` and `publish`. `total` is
/// `fill`, `round_trip` and `decode`. Percentiles do not add up; stages of one frame do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Memory borrowed and the boxes written into it, in the form of the mode.
    pub fill_ns: Percentiles,
    /// Boxes turned into the engine's form.
    pub ingest_ns: Percentiles,
    /// Plan made.
    pub plan_ns: Percentiles,
    /// Pairs tested.
    pub execute_ns: Percentiles,
    /// Mask written.
    pub publish_ns: Percentiles,
    /// All of the engine's time.
    pub engine_ns: Percentiles,
    /// Boxes submitted to mask in hand.
    pub round_trip_ns: Percentiles,
    /// Every pair of the mask looked at once.
    pub decode_ns: Percentiles,
    /// The whole frame.
    pub total_ns: Percentiles,
}

/// One scene of n boxes in motion, culled in one mode by one engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AccuracyRow {
    /// Name of the scene.
    pub scene: String,
    /// Boxes.
    pub n: u32,
    /// The mode: `exact`, `q16`, `q8`, `f16`, `f64`, `margin` or `spheres`.
    pub mode: String,
    /// Of the mode `margin`: how far boxes are inflated, in units of the scene; else null.
    pub margin: Option<f64>,
    /// Who found the pairs: `daemon` or `in-process`.
    pub backend: String,
    /// The engine that was asked for, `auto` where the plan chose.
    pub engine: String,
    /// The engine that answered the last frame.
    pub served_by_engine: String,
    /// Frames that were timed.
    pub frames: u64,
    /// Frames that were asked for; the others were answered by a mask that was kept.
    pub requests: u64,
    /// Times over all timed frames, those without a request included.
    pub times: StageTimes,
    /// Bytes of the boxes of one request.
    pub bytes_up: u64,
    /// Bytes of the mask of one request, the mean over all of them.
    pub bytes_down: u64,
    /// Frames whose pairs were compared with the exact ones.
    pub checked_frames: u64,
    /// Exact pairs in those frames.
    pub true_pairs: u64,
    /// Exact pairs that were not reported. Anything but 0 disqualifies the mode.
    pub missed: u64,
    /// Reported pairs that are not exact ones.
    pub extra: u64,
    /// `extra / true_pairs`, 0 where both are 0; null where only `true_pairs` is.
    pub extra_ratio: Option<f64>,
    /// Resident memory of client and daemon together at the end of the row, bytes.
    pub memory_bytes: u64,
}

impl AccuracyRow {
    /// What tells rows of two reports to be about the same thing.
    pub fn key(&self) -> (&str, u32, &str, Option<u64>, &str, &str) {
        let margin = self.margin.map(f64::to_bits);
        (&self.scene, self.n, &self.mode, margin, &self.backend, &self.engine)
    }

    /// The mode as the command line has it.
    pub fn mode_text(&self) -> String {
        self.margin.map_or_else(|| self.mode.clone(), |margin| format!("{}={margin}", self.mode))
    }

    /// What the row is about, for messages.
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
        let total_ns = Percentiles { p50: 500_000, p99: 1_500_000 };
        AccuracyRow {
            scene: "uniform".to_owned(),
            n: 1000,
            mode: "margin".to_owned(),
            margin: Some(0.1),
            backend: "daemon".to_owned(),
            engine: "auto".to_owned(),
            served_by_engine: "cpu-grid".to_owned(),
            frames: 200,
            requests: 40,
            times: StageTimes { total_ns, ..StageTimes::default() },
            bytes_up: 24_000,
            bytes_down: 12_000,
            checked_frames: 4,
            true_pairs: 4000,
            missed: 0,
            extra: 100,
            extra_ratio: AccuracyRow::ratio(100, 4000),
            memory_bytes: 1 << 30,
        }
    }

    pub fn report(rows: Vec<AccuracyRow>) -> AccuracyReport {
        AccuracyReport { machine: Machine::here(None), seed: 1, rows }
    }

    #[test]
    fn a_report_survives_json() -> Result<(), serde_json::Error> {
        let report = report(vec![row()]);
        let text = serde_json::to_string(&report)?;
        assert_eq!(serde_json::from_str::<AccuracyReport>(&text)?, report);
        Ok(())
    }

    #[test]
    fn ratios_exist_where_there_is_something_to_divide_by() {
        assert_eq!(AccuracyRow::ratio(0, 0), Some(0.0));
        assert_eq!(AccuracyRow::ratio(1, 0), None);
        assert_eq!(AccuracyRow::ratio(1, 4), Some(0.25));
    }
}
