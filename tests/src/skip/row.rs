//! A row of the report: a scene of which some boxes move, beside a peer in the same state.

use pairmask_lab::study::moving::Motion;
use serde_json::{Value, json};

/// Times of the frames of a row, ns.
#[derive(Clone, Debug, Default)]
pub struct Times {
    /// The edit written and sent.
    pub write: Vec<u64>,
    /// Until the answer is there.
    pub round_trip: Vec<u64>,
    /// Every change read, the answer taken.
    pub visit: Vec<u64>,
    /// The whole frame: the sum of these, or more where it began late.
    pub total: Vec<u64>,
}

/// The value below which a share of the values lies; 0 of none.
pub fn percentile(values: &[u64], share: f64) -> u64 {
    let mut values = values.to_vec();
    values.sort_unstable();
    let place = (values.len().saturating_sub(1) as f64 * share).round() as usize;
    values.get(place).copied().unwrap_or(0)
}

/// A row. Times are medians, ns.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The scene's name.
    pub scene: String,
    /// Boxes.
    pub n: usize,
    /// The share of them that moves in a frame.
    pub moving: f64,
    /// How they move.
    pub motion: Motion,
    /// Who keeps the scene.
    pub backend: String,
    /// What answered the last frame.
    pub engine: String,
    /// The edit written and sent.
    pub write_ns: u64,
    /// Until the answer is there.
    pub round_trip_ns: u64,
    /// Every change read.
    pub visit_ns: u64,
    /// All of it.
    pub total_ns: u64,
    /// 99 of 100 frames.
    pub p99_ns: u64,
    /// What it is set beside.
    pub peer: &'static str,
    /// Its time.
    pub peer_ns: u64,
    /// Changes of the last frame.
    pub changes: usize,
    /// What is kept, bytes a box.
    pub bytes_a_box: f64,
}

impl Row {
    /// Time over the peer's: below 1 is in favour of the scene.
    pub fn ratio(&self) -> f64 {
        self.total_ns as f64 / self.peer_ns.max(1) as f64
    }

    /// The row of the JSON.
    pub fn json(&self) -> Value {
        let Self { scene, n, moving, backend, engine, write_ns, round_trip_ns, .. } = self;
        let Self { visit_ns, total_ns, peer, peer_ns, .. } = self;
        json!({
            "scene": scene, "n": n, "moving": moving, "motion": self.motion.name(),
            "backend": backend, "engine": engine, "write_ns": write_ns,
            "round_trip_ns": round_trip_ns, "visit_ns": visit_ns, "total_ns": total_ns,
            "peer": peer, "peer_ns": peer_ns, "ratio": self.ratio(),
        })
    }

    /// The head of the table.
    pub fn head() -> String {
        format!(
            "{:>9} {:>9} {:>8} {:>9} {:>10} {:>10} {:>9} {:>10} {:>9} {:>10} {:>10} {:>13} {:>10} {:>7} {:>9} {:>6}",
            "scene",
            "n",
            "moving",
            "motion",
            "backend",
            "engine",
            "write µs",
            "answer",
            "visit",
            "total",
            "p99",
            "peer",
            "peer µs",
            "ratio",
            "changes",
            "bytes"
        )
    }

    /// The row of the table.
    pub fn line(&self) -> String {
        let us = |ns: u64| ns as f64 / 1e3;
        format!(
            "{:>9} {:>9} {:>7}% {:>9} {:>10} {:>10} {:>9.1} {:>10.1} {:>9.1} {:>10.1} {:>10.1} {:>13} {:>10.1} {:>7.4} {:>9} {:>6.0}",
            self.scene,
            self.n,
            // 0.0001 · 100 is no round number.
            (self.moving * 1e6).round() / 1e4,
            self.motion.name(),
            self.backend,
            self.engine,
            us(self.write_ns),
            us(self.round_trip_ns),
            us(self.visit_ns),
            us(self.total_ns),
            us(self.p99_ns),
            self.peer,
            us(self.peer_ns),
            self.ratio(),
            self.changes,
            self.bytes_a_box,
        )
    }
}

#[cfg(test)]
pub(super) fn example() -> Row {
    Row {
        scene: "pile".to_owned(),
        n: 10_000,
        moving: 0.01,
        motion: Motion::Drift,
        backend: "in-process".to_owned(),
        engine: "cpu-grid".to_owned(),
        write_ns: 10_000,
        round_trip_ns: 20_000,
        visit_ns: 5_000,
        total_ns: 35_000,
        p99_ns: 60_000,
        peer: "whole-frame",
        peer_ns: 350_000,
        changes: 17,
        bytes_a_box: 98.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_json_has_the_documented_fields_and_no_others() {
        let json = example().json();
        let mut names: Vec<&String> = json.as_object().expect("an object").keys().collect();
        names.sort();
        let mut documented = [
            "scene",
            "n",
            "moving",
            "motion",
            "backend",
            "engine",
            "write_ns",
            "round_trip_ns",
            "visit_ns",
            "total_ns",
            "peer",
            "peer_ns",
            "ratio",
        ];
        documented.sort_unstable();
        assert_eq!(names, documented);
        assert_eq!((json["ratio"].as_f64(), json["moving"].as_f64()), (Some(0.1), Some(0.01)));
    }

    #[test]
    fn a_line_has_a_column_for_each_name_of_the_head() {
        let columns = |line: String| line.replace(" µs", "").split_whitespace().count();
        assert_eq!(columns(example().line()), columns(Row::head()));
        assert!(Row { moving: 0.0001, ..example() }.line().contains(" 0.01%"));
    }

    #[test]
    fn percentiles_are_values_that_were_measured() {
        assert_eq!(percentile(&[], 0.5), 0);
        assert_eq!(percentile(&[9, 1, 5], 0.5), 5);
        assert_eq!(percentile(&[9, 1, 5], 0.99), 9);
    }
}
