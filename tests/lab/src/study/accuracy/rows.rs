//! The figures of the accuracy study, as written to JSON.
//!
//! Fields may be added, never changed or taken away. `README.md` says what they mean.

use std::collections::BTreeMap;

use serde::Serialize;

use super::truth::Difference;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Percentiles {
    pub p50: u64,
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
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AccuracyRow {
    pub scene: String,
    pub n: u32,
    pub mode: String,
    pub margin: Option<f64>,
    pub offset: Option<f64>,
    pub spheres: Option<String>,
    pub backend: String,
    pub engine: String,
    pub served_by_engine: String,
    pub frames: u64,
    pub requests: u64,
    pub times: BTreeMap<&'static str, Percentiles>,
    pub bytes_up: u64,
    pub bytes_down: u64,
    pub checked_frames: u64,
    #[serde(flatten)]
    pub found: Difference,
    /// Of objects that stand for boxes, against the boxes' pairs.
    pub against_boxes: Option<Difference>,
    pub memory_bytes: u64,
}

impl AccuracyRow {
    pub fn time(&self, stage: &str) -> Percentiles {
        self.times.get(stage).copied().unwrap_or_default()
    }

    pub fn p50(&self) -> u64 {
        self.time("total_ns").p50
    }

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
        let ratio = self.against_boxes.unwrap_or(self.found).extra_ratio;
        ratio.filter(|_| self.missed_of_boxes() == 0 && self.checked_frames > 0)
    }

    pub fn missed_of_boxes(&self) -> u64 {
        self.found.missed + self.against_boxes.map_or(0, |boxes| boxes.missed)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn row() -> AccuracyRow {
        AccuracyRow {
            margin: Some(0.1),
            times: totals(500_000, 1_500_000),
            found: Difference::of(4000, 0, 100),
            ..of_mode("margin", 0, 100, 0)
        }
    }

    /// A row of a mode without a number, of 1,000 true pairs.
    pub fn of_mode(mode: &str, p50: u64, extra: u64, missed: u64) -> AccuracyRow {
        AccuracyRow {
            scene: "uniform".to_owned(),
            n: 1000,
            mode: mode.to_owned(),
            margin: None,
            offset: None,
            spheres: None,
            backend: "daemon".to_owned(),
            engine: "auto".to_owned(),
            served_by_engine: "cpu-grid".to_owned(),
            frames: 200,
            requests: 40,
            times: totals(p50, 2 * p50),
            bytes_up: 24_000,
            bytes_down: 12_000,
            checked_frames: 4,
            found: Difference::of(1000, missed, extra),
            against_boxes: None,
            memory_bytes: 1 << 30,
        }
    }

    pub fn totals(p50: u64, p99: u64) -> BTreeMap<&'static str, Percentiles> {
        let stage = |stage: &'static str| {
            let times = Percentiles { p50, p99 };
            (stage, if stage == "total_ns" { times } else { Percentiles::default() })
        };
        STAGES.map(stage).into()
    }

    #[test]
    fn spheres_are_judged_by_the_boxes_a_missed_pair_by_nothing_and_percentiles_are_measured() {
        let boxes = Difference::of(10, 0, 5);
        assert_eq!(row().error(), Some(0.025));
        let with = |against_boxes| AccuracyRow { against_boxes, ..row() }.error();
        assert_eq!(with(Some(boxes)), Some(0.5));
        assert_eq!(with(Some(Difference { missed: 1, ..boxes })), None);
        let found = Difference { missed: 1, ..row().found };
        assert_eq!(AccuracyRow { found, ..row() }.error(), None);
        assert_eq!(AccuracyRow { checked_frames: 0, ..row() }.error(), None);
        assert_eq!(Difference::of(0, 0, 0), Difference::NONE);
        assert_eq!((Difference::of(0, 0, 1).extra_ratio, boxes.extra_ratio), (None, Some(0.5)));
        assert_eq!(Percentiles::of(vec![]), Percentiles::default());
        let hundred: Vec<u64> = (1..=100).rev().collect();
        assert_eq!(Percentiles::of(hundred), Percentiles { p50: 50, p99: 99 });
    }
}
