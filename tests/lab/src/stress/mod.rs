//! Stress: thousands of hard scenes a minute, each answered by every engine and compared with the oracle.
//!
//! A run's seed gives each `Case` a seed of its own, which determines the boxes and the floating-point flags
//! ([`MixedFlags`]) of all threads that take part: no answer may depend on them. Each `Subject` answers every case in
//! its `Form` (boxes, spheres, a precision mode), and `Case::check` holds the answer to the oracle. What
//! an engine leaves to another one because a scene is crowded (`Reply::Declined`) is counted and printed: a run
//! without answers proves nothing. The same cases go through a daemon (`clients`).
//!
//! To add another way to find pairs, list another `Subject` in `roster.rs`.

mod answer;
mod case;
mod changes;
pub(crate) mod clients;
mod flags;
pub(crate) mod hard;
mod modes;
mod report;
mod roster;
pub mod scenes;
mod spheres;
#[cfg(test)]
mod tests;

pub(crate) use answer::{Answer, Finding, Form, Reply, absent, compare};
pub(crate) use case::Case;
pub use flags::{FloatFlags, MixedFlags, Rounding};
pub(crate) use report::{Failure, StressReport};
pub(crate) use roster::{Requested, Roster};
pub use spheres::SphereCase;

use std::time::{Duration, Instant, SystemTime};

use pairmaskd::scene::Random;

/// Failures after which a run ends: more of them say nothing new.
pub(crate) const MOST_FAILURES: usize = 10;

pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) engine: &'static str,
    pub(crate) form: Form,
    /// Answers a case; [`Finding`] where it cannot, or where the answer was compared already and is wrong.
    answer: Box<Answering>,
}

type Answering = dyn FnMut(&Case) -> Result<Reply, Finding>;

/// A seed that is another one for each run.
pub(crate) fn clock_seed() -> u64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    now.map_or(1, |time| u64::from(time.subsec_micros()) + 1_000_000 * (time.as_secs() % 1_000))
}

/// Runs the case of the seed, or with a time case after case of its stream, until the time is over.
pub(crate) fn run(
    seed: u64,
    time: Option<Duration>,
    subjects: &mut [Subject],
    mut watch: impl FnMut(u64, Duration),
) -> StressReport {
    let start = Instant::now();
    let names = subjects.iter().map(|subject| subject.name.clone()).collect();
    let mut report = StressReport::new(seed, names);
    let mut seeds = Random::new(seed);
    // At least one case runs: a run that checks nothing proves nothing.
    loop {
        let case = if time.is_some() { Case::next_seed(&mut seeds) } else { seed };
        let case = &Case::new(case);
        report.cases += 1;
        for subject in &mut *subjects {
            report.answers += 1;
            let form = subject.form;
            let compared = (subject.answer)(case).and_then(|reply| match reply {
                Reply::Pairs(answer) => case.check(form, &answer),
                Reply::Right => Ok(()),
                Reply::Declined => {
                    report.skip(&subject.name);
                    Ok(())
                }
            });
            if let Err(finding) = compared {
                let (engine, mode) = (subject.engine, form.mode());
                let replay = "pairmask-lab stress --case";
                let replay = format!("{replay} {} --engine {engine} --mode {mode}", case.seed);
                report.fail(Failure::new(case, form, subject.name.clone(), replay, finding));
            }
        }
        watch(report.cases, start.elapsed());
        let is_over = time.is_none_or(|time| start.elapsed() >= time);
        if is_over || report.failures.len() >= MOST_FAILURES {
            break;
        }
    }
    report.elapsed_ns = start.elapsed().as_nanos() as u64;
    report
}
