//! Whether a quantity grew in the course of a soak: a percentile of the last quarter of its samples against that of the
//! second quarter. The first warms up; a median disregards a moment's load.

use serde::Serialize;

use super::sample::Sample;
use crate::study::harness::percentile;

/// Growth that is no leak: noise of the load, such as how large the scenes of the clients of the moment are.
#[derive(Clone, Copy, Debug)]
struct Tolerance {
    percent: f64,
    /// In the unit of the quantity: a share of little is nothing.
    slack: f64,
}

struct Quantity {
    name: &'static str,
    /// Which percentile of a quarter's samples is compared.
    percentile: usize,
    tolerance: Tolerance,
    of: fn(&Sample) -> Option<u64>,
}

const MIB: f64 = 1_048_576.0;

const MEDIAN: usize = 50;
/// Other programs of the machine slow frames down, for minutes, and never make them quicker: the quick samples are the
/// daemon's own.
const QUICK: usize = 10;

/// What must not grow. A tenth is far below what a leak of 1 % a minute makes within an hour, a quarter. The slack is what
/// two clients more at a time make, which are leaving for instance: about 13 descriptors and 25 mappings each, and 9 MiB for
/// each dense mask of 12,000 boxes. Six clients open a session each second: within ten minutes one descriptor or mapping for
/// each is far more. A heap keeps holes from its largest scenes: it grows by 10 MiB from the third to the tenth minute, and
/// levels off after half an hour.
const QUANTITIES: [Quantity; 9] = [
    Quantity {
        name: "anonymous_bytes",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 16.0 * MIB },
        of: |sample| sample.anonymous_bytes,
    },
    Quantity {
        name: "shared_bytes",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 32.0 * MIB },
        of: |sample| sample.shared_bytes,
    },
    Quantity {
        name: "descriptors",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 32.0 },
        of: |sample| sample.descriptors,
    },
    Quantity {
        name: "mappings",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 64.0 },
        of: |sample| sample.mappings,
    },
    Quantity {
        name: "threads",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 0.0, slack: 2.0 },
        of: |sample| sample.threads,
    },
    Quantity {
        name: "shm_used_bytes",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 32.0 * MIB },
        of: |sample| sample.shm_used_bytes,
    },
    Quantity {
        name: "shm_files",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 8.0 },
        of: |sample| sample.shm_files,
    },
    Quantity {
        name: "probe_p50_ns",
        percentile: QUICK,
        tolerance: Tolerance { percent: 100.0, slack: 5e5 },
        of: |sample| sample.probe_p50_ns,
    },
    Quantity {
        name: "probe_p99_ns",
        percentile: QUICK,
        tolerance: Tolerance { percent: 200.0, slack: 1e7 },
        of: |sample| sample.probe_p99_ns,
    },
];

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    Flat,
    Grew,
    /// A quarter has no sample of it: nothing is known.
    NotMeasured,
}

/// A row of `quantities` in the JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Growth {
    pub(crate) quantity: &'static str,
    pub(crate) verdict: Verdict,
    pub(crate) second_quarter: Option<u64>,
    pub(crate) last_quarter: Option<u64>,
    /// The most that the last quarter may have.
    pub(crate) limit: Option<u64>,
}

pub(crate) fn growths(samples: &[Sample]) -> Vec<Growth> {
    let growth = |quantity: &Quantity| {
        let values: Vec<Option<u64>> = samples.iter().map(quantity.of).collect();
        Growth::of(quantity, &values)
    };
    QUANTITIES.iter().map(growth).collect()
}

impl Growth {
    fn of(quantity: &Quantity, values: &[Option<u64>]) -> Self {
        let n = values.len();
        let of = |quarter: &[Option<u64>]| {
            let there: Vec<f64> = quarter.iter().flatten().map(|value| *value as f64).collect();
            (!there.is_empty()).then(|| percentile(there, quantity.percentile))
        };
        let (second_quarter, last_quarter) = (of(&values[n / 4..n / 2]), of(&values[n - n / 4..]));
        let Tolerance { percent, slack } = quantity.tolerance;
        let most = |value: f64| (value * (1.0 + percent / 100.0)).max(value + slack);
        let limit = second_quarter.map(most);
        let verdict = match (last_quarter, limit) {
            (Some(last), Some(limit)) if last > limit => Verdict::Grew,
            (Some(_), Some(_)) => Verdict::Flat,
            _ => Verdict::NotMeasured,
        };
        let [second_quarter, last_quarter, limit] =
            [second_quarter, last_quarter, limit].map(|value| value.map(|value| value as u64));
        Self { quantity: quantity.name, verdict, second_quarter, last_quarter, limit }
    }
}

#[cfg(test)]
mod tests {
    use pairmaskd::scene::Random;

    use super::*;

    /// Samples every 10 s of an hour.
    const SAMPLES: usize = 360;
    const QUANTITY: Quantity = Quantity {
        name: "",
        percentile: MEDIAN,
        tolerance: Tolerance { percent: 10.0, slack: 8.0 },
        of: |sample| sample.descriptors,
    };

    /// A value of a million with noise of a fifth to both sides, times what `grow` says of the minute.
    fn series(grow: impl Fn(f64) -> f64) -> Vec<Option<u64>> {
        let mut random = Random::new(7);
        let mut value = |i| {
            let noise = 1.0 + f64::from(random.range(-0.2, 0.2));
            Some((1e6 * noise * grow(i as f64 / 6.0)) as u64)
        };
        (0..SAMPLES).map(&mut value).collect()
    }

    fn verdict(values: &[Option<u64>]) -> Verdict {
        Growth::of(&QUANTITY, values).verdict
    }

    #[test]
    fn a_leak_of_a_percent_a_minute_is_noticed_and_noise_is_not() {
        assert_eq!(verdict(&series(|minute| 1.0 + 0.01 * minute)), Verdict::Grew);
        assert_eq!(verdict(&series(|_| 1.0)), Verdict::Flat);
        // What shrinks, warms up or is high for some minutes has not grown.
        assert_eq!(verdict(&series(|minute| 1.0 - 0.01 * minute)), Verdict::Flat);
        assert_eq!(verdict(&series(|minute| (minute / 10.0).min(1.0))), Verdict::Flat);
        let is_loaded = |minute: f64| (50.0..55.0).contains(&minute);
        let loaded = series(|minute| if is_loaded(minute) { 3.0 } else { 1.0 });
        assert_eq!(verdict(&loaded), Verdict::Flat);
        // What steps up and stays has.
        assert_eq!(verdict(&series(|m| if m > 40.0 { 1.2 } else { 1.0 })), Verdict::Grew);
    }

    #[test]
    fn a_busy_machine_is_no_slower_daemon() {
        // Of fewer quick samples the tenth percentile is a slower one of them.
        let tolerance = Tolerance { percent: 20.0, ..QUANTITY.tolerance };
        let quick = Quantity { percentile: QUICK, tolerance, ..QUANTITY };
        let verdict = |values: &[Option<u64>]| Growth::of(&quick, values).verdict;
        // Two minutes of four others run.
        let is_busy = |minute: f64| minute > 30.0 && minute % 4.0 >= 2.0;
        let busy = |grow: f64| {
            series(move |minute| (1.0 + grow * minute) * if is_busy(minute) { 20.0 } else { 1.0 })
        };
        assert_eq!((verdict(&busy(0.0)), verdict(&busy(0.01))), (Verdict::Flat, Verdict::Grew));
    }

    #[test]
    fn little_may_grow_by_the_slack_and_no_more() {
        let of = |last| [[Some(3); 4], [last; 4]].concat();
        let found = Growth::of(&QUANTITY, &of(Some(11)));
        assert_eq!(
            (found.second_quarter, found.last_quarter, found.limit),
            (Some(3), Some(11), Some(11))
        );
        assert_eq!((found.verdict, verdict(&of(Some(12)))), (Verdict::Flat, Verdict::Grew));
    }

    #[test]
    fn what_was_not_measured_is_not_flat() {
        for values in [&[][..], &[Some(1); 3], &[None; 40], &[[Some(1); 20], [None; 20]].concat()] {
            assert_eq!(verdict(values), Verdict::NotMeasured, "{values:?}");
        }
        // Samples that are missing here and there, while a worker is restarted, do no harm.
        let mut gaps = series(|minute| 1.0 + 0.01 * minute);
        gaps.iter_mut().step_by(3).for_each(|value| *value = None);
        assert_eq!(verdict(&gaps), Verdict::Grew);
    }

    #[test]
    fn each_quantity_that_grows_is_named() {
        let sample = |x: u64| Sample {
            anonymous_bytes: Some(x << 20),
            shared_bytes: Some(x << 20),
            descriptors: Some(x),
            mappings: Some(x),
            threads: Some(x),
            shm_used_bytes: Some(x << 20),
            shm_files: Some(x),
            probe_p50_ns: Some(x * 1_000_000),
            probe_p99_ns: Some(x * 1_000_000),
            ..Sample::default()
        };
        let flat: Vec<Sample> = (0..SAMPLES).map(|_| sample(100)).collect();
        assert!(growths(&flat).iter().all(|growth| growth.verdict == Verdict::Flat));
        for (at, quantity) in QUANTITIES.iter().enumerate() {
            let mut samples = flat.clone();
            let much = sample(400);
            for late in &mut samples[SAMPLES / 2..] {
                match at {
                    0 => late.anonymous_bytes = much.anonymous_bytes,
                    1 => late.shared_bytes = much.shared_bytes,
                    2 => late.descriptors = much.descriptors,
                    3 => late.mappings = much.mappings,
                    4 => late.threads = much.threads,
                    5 => late.shm_used_bytes = much.shm_used_bytes,
                    6 => late.shm_files = much.shm_files,
                    7 => late.probe_p50_ns = much.probe_p50_ns,
                    _ => late.probe_p99_ns = much.probe_p99_ns,
                }
            }
            let grew = growths(&samples).into_iter().filter(|g| g.verdict == Verdict::Grew);
            let names: Vec<_> = grew.map(|growth| growth.quantity).collect();
            assert_eq!(names, [quantity.name]);
        }
    }
}
