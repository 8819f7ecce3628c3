//! What follows from the figures: which ways stay in, which is best, and from how many boxes on which host is.

use super::options::{Host, Way};

/// Ways whose times differ by less than this count as equal: other programs on the machine make as much. The simpler one
/// is advised then.
const NOISE: f64 = 1.05;
/// Another way takes over from a number of boxes on where it takes so much less than the one before.
const TAKE_OVER: f64 = 1.15;
/// A way that takes this many times as long as the best one in its first measurement is not measured again.
const HOPELESS: f64 = 2.0;

/// What ticks took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    pub ticks: u64,
    /// The mean over the ticks of the work, of each the median of its repetitions.
    pub usual_ns: u64,
    pub p50_ns: u64,
    pub p99_ns: u64,
    /// CPU time of a tick, of this process and the daemon.
    pub cpu_ns: u64,
    /// Pairs that were iterated over in a tick.
    pub pairs: u64,
}

/// A way, and what ticks take with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    pub way: Way,
    pub figures: Figures,
    /// How often it was measured: those that stay in longer were measured beside each other.
    pub rounds: u32,
}

/// Which of the ways that may be taken is the best, among those that were measured to the end.
pub fn best(samples: &[Sample], accepts_near: bool) -> Option<usize> {
    let last = samples.iter().map(|sample| sample.rounds).max()?;
    let is_in = |sample: &Sample| sample.rounds == last && (accepts_near || !sample.way.is_near());
    let all = || samples.iter().enumerate().filter(|(_, sample)| is_in(sample));
    let least = all().map(|(_, sample)| sample.figures.usual_ns).min()?;
    let is_best =
        |(_, sample): &(usize, &Sample)| sample.figures.usual_ns as f64 <= NOISE * least as f64;
    let key = |(_, sample): &(usize, &Sample)| (sample.way.complexity(), sample.figures.usual_ns);
    all().filter(is_best).min_by_key(key).map(|(at, _)| at)
}

/// The ways that are measured again: the fastest, so many, and of those that may not be taken the fastest one, to show
/// what near pairs would save.
pub fn stay_in(samples: &[Sample], accepts_near: bool, most: usize) -> Vec<usize> {
    let last = samples.iter().map(|sample| sample.rounds).max().unwrap_or(0);
    let of = |may_be_taken: bool| {
        let is_of = |sample: &Sample| may_be_taken == (accepts_near || !sample.way.is_near());
        let mut all: Vec<usize> = (0..samples.len())
            .filter(|at| samples[*at].rounds == last && is_of(&samples[*at]))
            .collect();
        all.sort_by_key(|at| samples[*at].figures.usual_ns);
        all
    };
    let mut stay = of(true);
    if let Some(first) = stay.first() {
        let most_ns = HOPELESS * samples[*first].figures.usual_ns as f64;
        stay.retain(|at| samples[*at].figures.usual_ns as f64 <= most_ns);
    }
    stay.truncate(most);
    stay.extend(of(false).first());
    stay
}

/// What ticks take with several hosts, by the number of boxes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sizes {
    /// The simpler ones first.
    pub ways: Vec<Way>,
    /// Boxes, and the usual time with each of the ways, ns.
    pub rows: Vec<(usize, Vec<u64>)>,
}

/// From how many boxes on a way is the best one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Takeover {
    pub from: usize,
    pub way: usize,
}

/// Which way is best from how many boxes on. One that is best at a single size between two at which another one is,
/// is noise.
pub fn take_overs(sizes: &Sizes) -> Vec<Takeover> {
    let mut best: Vec<usize> = Vec::new();
    for (_, ns) in &sizes.rows {
        let stays = best.last().copied().filter(|way| is_near_best(ns, *way));
        let first = || (0..ns.len()).find(|way| is_near_best(ns, *way)).unwrap_or(0);
        best.push(stays.unwrap_or_else(first));
    }
    for at in 1..best.len().saturating_sub(1) {
        if best[at - 1] == best[at + 1] {
            best[at] = best[at - 1];
        }
    }
    let mut found: Vec<Takeover> = Vec::new();
    for (at, way) in best.iter().enumerate() {
        match found.last_mut() {
            None => found.push(Takeover { from: 0, way: *way }),
            Some(last) if last.way == *way => {}
            Some(last) => {
                let from = crossing(sizes, at, [last.way, *way]);
                // Below the smallest size nothing is known.
                if from > sizes.rows[0].0 {
                    found.push(Takeover { from, way: *way });
                } else {
                    last.way = *way;
                }
            }
        }
    }
    found
}

fn is_near_best(ns: &[u64], way: usize) -> bool {
    let least = ns.iter().copied().min().unwrap_or(0);
    ns[way] as f64 <= TAKE_OVER * least as f64
}

/// The number of boxes at which the second way takes over, between two sizes: where straight lines over logarithms cross.
fn crossing(sizes: &Sizes, at: usize, [before, after]: [usize; 2]) -> usize {
    let ratio = |row: usize| {
        let ns = &sizes.rows[row].1;
        (ns[before].max(1) as f64 / ns[after].max(1) as f64).ln()
    };
    let [low, high] = [at - 1, at].map(|row| (sizes.rows[row].0 as f64).ln());
    let [slower, faster] = [ratio(at - 1), ratio(at)];
    let share = if faster > slower { (-slower / (faster - slower)).clamp(0.0, 1.0) } else { 1.0 };
    two_digits((low + share * (high - low)).exp())
}

fn two_digits(value: f64) -> usize {
    let unit = 10f64.powf(value.max(1.0).log10().floor() - 1.0).max(1.0);
    ((value / unit).round() * unit) as usize
}

/// The plainest way of those that were measured: what a program does that asked nobody.
pub fn plainest(samples: &[Sample]) -> Option<usize> {
    let is_plain = |sample: &&Sample| sample.way.host != Host::Gpu;
    let all = samples.iter().filter(is_plain);
    let plain = all.min_by_key(|sample| sample.way.complexity())?;
    samples.iter().position(|sample| sample.way == plain.way)
}

#[cfg(test)]
mod tests {
    use pairmask_core::EngineChoice;

    use super::super::options::Form;
    use super::*;
    use crate::precision::PrecisionChoice;

    fn sample(host: Host, precision: PrecisionChoice, threads: Option<usize>, us: u64) -> Sample {
        let form = Form::Frame(precision);
        let way = Way { form, host, threads, engine: EngineChoice::Auto };
        let figures = Figures { usual_ns: 1_000 * us, ..Figures::default() };
        Sample { way, figures, rounds: 1 }
    }

    const EXACT: PrecisionChoice = PrecisionChoice::Exact;
    const Q16: PrecisionChoice = PrecisionChoice::Q16;

    #[test]
    fn the_fastest_is_best_and_of_equals_the_simpler() {
        use Host::{Daemon, Gpu, InProcess};
        let mut samples = vec![
            sample(Daemon, EXACT, None, 100),
            sample(InProcess, EXACT, Some(1), 104),
            sample(InProcess, EXACT, None, 120),
            sample(InProcess, Q16, None, 50),
        ];
        assert_eq!(best(&samples, false), Some(1), "within noise of the fastest, and simpler");
        assert_eq!(best(&samples, true), Some(3), "near pairs do no harm");
        samples.push(sample(Gpu, EXACT, None, 90));
        assert_eq!(best(&samples, false), Some(4));
        // One that was measured longer counts alone.
        samples[2].rounds = 2;
        assert_eq!(best(&samples, false), Some(2));
        assert_eq!(best(&[], false), None);
        assert_eq!(plainest(&samples), Some(2));
    }

    #[test]
    fn the_fastest_stay_in_and_one_with_near_pairs() {
        let us = [500, 100, 130, 110, 120, 190];
        let samples: Vec<Sample> =
            us.iter().map(|us| sample(Host::InProcess, EXACT, None, *us)).collect();
        assert_eq!(stay_in(&samples, false, 3), [1, 3, 4]);
        assert_eq!(stay_in(&samples, false, 9), [1, 3, 4, 2, 5], "five times as long is hopeless");
        let near = [sample(Host::InProcess, Q16, None, 40), sample(Host::Daemon, Q16, None, 30)];
        let all = [&samples[..], &near[..]].concat();
        assert_eq!(stay_in(&all, false, 2), [1, 3, 7]);
        assert_eq!(stay_in(&all, true, 2), [7, 6]);
    }

    #[test]
    fn break_even_sizes_lie_where_the_lines_cross() {
        let ways = [Host::InProcess, Host::Daemon, Host::Gpu];
        let ways = ways.map(|host| sample(host, EXACT, None, 1).way).to_vec();
        // 1 ns a box; 50 µs and half of that; 1 ms and a tenth.
        let row = |n: usize| (n, vec![n as u64, 50_000 + n as u64 / 2, 1_000_000 + n as u64 / 10]);
        let rows = [1_000, 10_000, 100_000, 1_000_000, 10_000_000].map(row).to_vec();
        let mut sizes = Sizes { ways, rows };
        let found = take_overs(&sizes);
        let order: Vec<usize> = found.iter().map(|takeover| takeover.way).collect();
        assert_eq!(order, [0, 1, 2]);
        assert_eq!(found[0].from, 0);
        assert!((60_000..=200_000).contains(&found[1].from), "{found:?}");
        assert!((1_000_000..=4_000_000).contains(&found[2].from), "{found:?}");
        // A single size at which another one is faster is none.
        sizes.rows[1].1[2] = 1;
        assert_eq!(take_overs(&sizes).iter().map(|t| t.way).collect::<Vec<_>>(), [0, 1, 2]);
        assert!(take_overs(&Sizes::default()).is_empty());
    }
}
