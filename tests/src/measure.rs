//! What benches share: a daemon, the loop over pairs of pairs, percentiles, and when frames begin.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask_core::oracle::Pair;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::{PrivateDaemon, SpawnError};
use serde_json::Value;

use crate::daemon::pairmaskd;

pub fn daemon(gpu: GpuChoice) -> Result<PrivateDaemon, SpawnError> {
    let settings = DaemonSettings { gpu: gpu.into(), ..DaemonSettings::default() };
    PrivateDaemon::start(&pairmaskd(), &settings)
}

/// Looks at all pairs that are handed over slice by slice. Returns how many there were.
pub fn iterate(each_slice: impl FnOnce(&mut dyn FnMut(&[Pair]))) -> u64 {
    let (mut sum, mut count) = (0u64, 0);
    each_slice(&mut |pairs| {
        sum = pairs.iter().fold(sum, |sum, [a, b]| sum + u64::from(a ^ b));
        count += pairs.len() as u64;
    });
    black_box(sum);
    count
}

/// Prints some fields of a row, each number with its name.
pub fn print_row(row: &Value, columns: &str) {
    let cell = |name: &str| match &row[name] {
        Value::String(text) => format!("{text:<12}"),
        Value::Number(number) if number.is_f64() => {
            format!("{name} {:>9.3}", number.as_f64().unwrap_or_default())
        }
        other => format!("{name} {other:>9}"),
    };
    println!("{}", columns.split(' ').map(cell).collect::<Vec<_>>().join("  "));
}

/// The value below which a share of the values lies, one that was measured; the default of none.
pub fn percentile<T: Copy + Default + PartialOrd>(values: &[T], share: f64) -> T {
    let mut values = values.to_vec();
    values.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let slot = (values.len().saturating_sub(1) as f64 * share).round() as usize;
    values.get(slot).copied().unwrap_or_default()
}

/// The rest of a wait that is spun: what a sleep may be late by, so that a frame begins when it is due.
const SPIN: Duration = Duration::from_micros(200);

/// When each frame of a run is due: after the one before (a closed loop), or at equal intervals, whether that is done
/// or not. The time of a late frame counts from when it was due.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    start: Instant,
    period: Option<Duration>,
}

impl Pace {
    /// The pace of a run that begins now, by frames a second; `None` is a closed loop.
    pub fn from_now(rate: Option<f64>) -> Self {
        let period = rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
        Self { start: Instant::now(), period }
    }

    /// Waits until a frame is due, and returns that instant. A frame that is late does not wait.
    pub fn wait(&self, frame: u32) -> Instant {
        let Some(period) = self.period else { return Instant::now() };
        let due = self.start + period * frame;
        let left = due.saturating_duration_since(Instant::now());
        std::thread::sleep(left.saturating_sub(SPIN));
        while Instant::now() < due {
            std::hint::spin_loop();
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_were_measured() {
        assert_eq!(percentile::<u64>(&[], 0.5), 0);
        assert_eq!(percentile(&[9, 1, 5], 0.5), 5);
        assert_eq!(percentile(&[9.0, 1.0, 5.0], 0.99), 9.0);
        let times: Vec<u64> = (0..=100).rev().collect();
        assert_eq!([0.0, 0.1, 0.9].map(|share| percentile(&times, share)), [0, 10, 90]);
    }

    #[test]
    fn frames_at_a_pace_are_due_at_equal_intervals_however_long_they_took() {
        let pace = Pace::from_now(Some(500.0));
        let first = pace.wait(0);
        std::thread::sleep(Duration::from_millis(7));
        // Late by two periods and more: it is due when it was.
        assert_eq!(pace.wait(1) - first, Duration::from_millis(2));
        let last = pace.wait(8);
        assert_eq!(last - first, Duration::from_millis(16));
        assert!(Instant::now() >= last, "no frame begins before it is due");
    }
}
