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

/// Collects latencies. Recording allocates nothing.
#[derive(Clone, Debug)]
pub struct Recorder(Histogram<u64>);

impl Recorder {
    /// An empty histogram.
    ///
    /// # Panics
    /// Never: the bounds are constants, and valid.
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS);
        Self(histogram.expect("constant bounds, checked by a test"))
    }

    /// Adds one latency.
    pub fn record(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    /// Removes all latencies.
    pub fn clear(&mut self) {
        self.0.reset();
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
        let mut recorder = Recorder::new();
        assert_eq!(recorder.percentiles(), Percentiles::default());
        for ns in 1..=1000 {
            recorder.record(ns);
        }
        let found = recorder.percentiles();
        assert_eq!((found.p50, found.p90, found.p99, found.p999), (500, 900, 990, 999));
        assert_eq!(found.max, 1000);
        recorder.record(u64::MAX);
        assert!(recorder.percentiles().max >= LONGEST_NS, "too long is counted as the longest");
        recorder.clear();
        assert_eq!(recorder.percentiles(), Percentiles::default());
    }
}
