//! Latencies as percentiles (HDR histogram: three digits, any scale).

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// The longest latency that is recorded, an hour; longer ones count as this.
const LONGEST_NS: u64 = 3_600_000_000_000;
/// Significant digits. Three cost 300 kB a histogram and err by 0.1 % at most.
const DIGITS: u8 = 3;

/// Percentiles of a latency, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    pub p50: u64,
    pub p90: u64,
    pub p99: u64,
    pub p999: u64,
    pub max: u64,
}

/// Collects latencies. Recording allocates nothing. Serialised as the latencies and how often each
/// was recorded.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Vec<(u64, u64)>", from = "Vec<(u64, u64)>")]
pub struct Recorder(Histogram<u64>);

impl From<Recorder> for Vec<(u64, u64)> {
    fn from(recorder: Recorder) -> Self {
        let recorded = recorder.0.iter_recorded();
        recorded.map(|step| (step.value_iterated_to(), step.count_at_value())).collect()
    }
}

impl From<Vec<(u64, u64)>> for Recorder {
    fn from(counts: Vec<(u64, u64)>) -> Self {
        let mut recorder = Self::default();
        for (ns, count) in counts {
            recorder.0.saturating_record_n(ns, count);
        }
        recorder
    }
}

impl Default for Recorder {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS);
        Self(histogram.expect("constant bounds, checked by a test"))
    }
}

impl Recorder {
    pub fn record(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    pub fn add(&mut self, other: &Self) {
        for step in other.0.iter_recorded() {
            self.0.saturating_record_n(step.value_iterated_to(), step.count_at_value());
        }
    }

    pub fn clear(&mut self) {
        self.0.reset();
    }

    /// How many latencies there are.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// The percentiles so far; zeros where nothing was recorded.
    pub fn percentiles(&self) -> Percentiles {
        let at = |quantile| self.0.value_at_quantile(quantile);
        Percentiles {
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: self.0.max(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_numbers() {
        let mut recorder = Recorder::default();
        assert_eq!(recorder.percentiles(), Percentiles::default());
        assert_eq!(recorder.count(), 0);
        for ns in 1..=1000 {
            recorder.record(ns);
        }
        let found = recorder.percentiles();
        assert_eq!((found.p50, found.p90, found.p99, found.p999), (500, 900, 990, 999));
        assert_eq!(found.max, 1000);
        assert_eq!(recorder.count(), 1000);
        recorder.record(u64::MAX);
        assert!(recorder.percentiles().max >= LONGEST_NS, "too long is counted as the longest");
        recorder.clear();
        assert_eq!(recorder.percentiles(), Percentiles::default());
    }

    #[test]
    fn recorders_add_up_and_survive_their_text() {
        let (mut low, mut high) = (Recorder::default(), Recorder::default());
        (1..=500).for_each(|ns| low.record(ns));
        (501..=1000).for_each(|ns| high.record(ns));
        low.add(&high);
        assert_eq!(low.percentiles().p50, 500);
        let text = serde_json::to_string(&low).expect("numbers");
        let read: Recorder = serde_json::from_str(&text).expect("what was written");
        assert_eq!(read.percentiles(), low.percentiles());
    }
}
