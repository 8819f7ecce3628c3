//! Stress: thousands of hard scenes a minute, each answered by every engine and compared with the
//! oracle.
//!
//! A run's seed gives each case a seed of its own. The case's seed determines the number of boxes,
//! one or two scenes ([`scenes`], [`hard`]) and up to three changes. Each [`Subject`] answers every
//! case. A wrong answer names the case's seed, the first wrong pair and why that pair is in the
//! mask or not.
//!
//! Precision modes take part as subjects too ([`modes`]): they must find the overlapping pairs and
//! may find those that their definition adds. No extra pair may have a larger gap than the mode
//! states (`gaps`).
//!
//! Each case also has floating-point flags ([`MixedFlags`]) for the caller, the pool's threads and the
//! writers of boxes: no answer may depend on them.
//!
//! An engine may leave a crowded scene to another one ([`Outcome::Declined`]). That is no failure, but
//! it is counted and printed: a run without answers proves nothing.
//!
//! The same scenes can go through a daemon, as frames of several client processes ([`clients`]).
//!
//! To add another way to find pairs, implement [`Subject`] and list it in `roster.rs`.

mod case;
mod changes;
pub mod clients;
mod flags;
mod gaps;
pub mod hard;
mod mode_subject;
pub mod modes;
mod report;
mod roster;
pub mod scene_edits;
mod scene_subject;
pub mod scenes;
mod spheres;
mod subject;
mod updates;

pub use case::{CASE_SEED_BITS, Case};
pub use flags::{FloatFlags, MixedFlags, Rounding};
pub use mode_subject::ModeSubject;
pub use modes::{Mode, ModeChoice};
pub use report::{Failure, Skipped, StressReport};
pub use roster::{Entrant, Roster};
pub use scene_subject::SceneSubject;
pub use spheres::{SphereCase, SphereSubject};
pub use subject::{ExactSubject, Finding, Outcome, Subject, compare};
pub use updates::UpdateSubject;

use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use pairmaskd::execute::gpu::{GpuError, OpenError};
use pairmaskd::scene::Random;

/// Failures after which a run ends: more of them say nothing new.
const MOST_FAILURES: usize = 10;

/// The cases to run.
#[derive(Clone, Debug)]
pub enum Cases {
    /// Case after case, until the time is over.
    Run {
        /// The seed, which determines the cases.
        seed: u64,
        /// How long.
        time: Duration,
    },
    /// This case and no other.
    One {
        /// Its seed.
        seed: u64,
    },
}

/// Why a run failed or did not begin.
#[derive(Debug, thiserror::Error)]
pub enum StressError {
    /// The GPU that was asked for does not exist.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The GPU engine cannot be made.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// An engine cannot be made.
    #[error(transparent)]
    Engine(#[from] CullError),
    /// No subject has both the chosen engine and the chosen mode.
    #[error("nothing to run: spheres and updates take part with --mode exact only")]
    NoSubject,
    /// No threads for an engine.
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Runs cases through all subjects. `watch` is called after each case with the number of cases and
/// the time since the start.
pub fn run(
    cases: &Cases,
    subjects: &mut [Box<dyn Subject>],
    mut watch: impl FnMut(u64, Duration),
) -> StressReport {
    let start = Instant::now();
    let mut report = StressReport::new(cases, subjects);
    match *cases {
        Cases::One { seed } => check_case(&Case::new(seed), subjects, &mut report),
        Cases::Run { seed, time } => {
            let mut seeds = Random::new(seed);
            // At least one case runs: a run that checks nothing proves nothing.
            loop {
                check_case(&Case::new(Case::next_seed(&mut seeds)), subjects, &mut report);
                watch(report.cases, start.elapsed());
                if start.elapsed() >= time || report.failures.len() >= MOST_FAILURES {
                    break;
                }
            }
        }
    }
    report.elapsed_ns = start.elapsed().as_nanos() as u64;
    report
}

fn check_case(case: &Case, subjects: &mut [Box<dyn Subject>], report: &mut StressReport) {
    report.cases += 1;
    for subject in subjects {
        report.answers += 1;
        let finding = match subject.check(case) {
            Ok(Outcome::Right) => continue,
            Ok(Outcome::Declined) => {
                report.skip(subject.name());
                continue;
            }
            Err(finding) => finding,
        };
        report.missed += finding.missed;
        report.extra += finding.extra;
        if report.failures.len() < MOST_FAILURES {
            report.failures.push(failure(case, subject.as_ref(), finding));
        }
    }
}

fn failure(case: &Case, subject: &dyn Subject, finding: Finding) -> Failure {
    let (boxes, scene) = subject.scene(case);
    let explain = finding.first.and_then(|pair| subject.explain(case, pair));
    Failure {
        case: case.seed,
        subject: subject.name().to_owned(),
        mode: subject.mode().as_str(),
        replay: format!(
            "pairmask-lab stress --case {} --engine {} --mode {}",
            case.seed,
            subject.engine(),
            subject.mode()
        ),
        boxes: boxes as u64,
        scene,
        flags: case.flags.to_string(),
        what: finding.what,
        missed: finding.missed,
        extra: finding.extra,
        pair: finding.first.map(|(i, j)| [i, j]),
        explain,
    }
}

#[cfg(test)]
mod tests;
