//! Stress: thousands of hard scenes a minute, each answered by every engine and compared with the
//! oracle.
//!
//! A run's seed gives each [`Case`] a seed of its own, which determines the number of boxes, one or two
//! scenes ([`scenes`], [`hard`]), up to three changes, and the floating-point flags ([`MixedFlags`]) of the
//! caller, the pool's threads and the writers of boxes: no answer may depend on them. A case is asked in a
//! [`Form`]: as boxes, spheres, in a precision mode, as edits of a scene that persists, as placements. Each
//! [`Subject`] answers every case in its form; one comparison ([`Case::check`]) holds the answer to the
//! oracle. A wrong one names the case's seed, the first wrong pair and why that pair is in the mask or not.
//!
//! Precision modes must find the overlapping pairs and may find those that their definition adds; no extra
//! pair may have a larger gap than the mode states ([`modes`]). What an engine leaves to another one because
//! a scene is crowded ([`Reply::Declined`]) is counted and printed: a run without answers proves nothing.
//!
//! The same cases go through a daemon, as frames of several client processes ([`clients`]). All verbs of
//! scenes, members of shared ones and rules are held to a model by the test `scene_model`; here are
//! hard boxes and flags, and scenes between the frames of many clients.
//!
//! To add another way to find pairs, implement [`Subject`] and list it in `roster.rs`.

mod answer;
mod case;
mod changes;
pub mod clients;
mod flags;
pub mod hard;
mod kept_scene;
pub mod modes;
mod report;
mod roster;
pub mod scenes;
mod spheres;
mod updates;

pub use answer::{Answer, Finding, Form, Reply, compare};
pub use case::{CASE_SEED_BITS, Case};
pub use flags::{FloatFlags, MixedFlags, Rounding};
pub use report::{Failure, Skipped, StressReport};
pub use roster::{CullSubject, Roster, Wanted};
pub use spheres::SphereCase;

use std::time::{Duration, Instant};

use pairmask_core::engine::CullError;
use pairmaskd::execute::gpu::{GpuError, OpenError};
use pairmaskd::scene::Random;

/// Failures after which a run ends: more of them say nothing new.
const MOST_FAILURES: usize = 10;

/// Who answers.
pub trait Subject {
    /// Name for messages: engine, instruction set, form, encoding, threads.
    fn name(&self) -> &str;

    /// The value of `--engine` that runs it.
    fn engine(&self) -> &'static str;

    /// How it is asked.
    fn form(&self) -> Form;

    /// Answers a case.
    ///
    /// # Errors
    /// [`Finding`] where it cannot, or where the answer was compared already and is wrong.
    fn answer(&mut self, case: &Case) -> Result<Reply, Finding>;
}

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
    #[error("nothing to run: spheres, updates and scenes take part with --mode exact only")]
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
    let (Cases::Run { seed, .. } | Cases::One { seed }) = *cases;
    let names = subjects.iter().map(|subject| subject.name().to_owned()).collect();
    let mut report = StressReport::new(seed, names);
    match *cases {
        Cases::One { seed } => ask(&Case::new(seed), subjects, &mut report),
        Cases::Run { seed, time } => {
            let mut seeds = Random::new(seed);
            // At least one case runs: a run that checks nothing proves nothing.
            loop {
                ask(&Case::new(Case::next_seed(&mut seeds)), subjects, &mut report);
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

/// Asks all subjects, and compares their answers.
fn ask(case: &Case, subjects: &mut [Box<dyn Subject>], report: &mut StressReport) {
    report.cases += 1;
    for subject in subjects {
        report.answers += 1;
        let form = subject.form();
        let compared = subject.answer(case).and_then(|reply| match reply {
            Reply::Pairs(answer) => case.check(form, &answer),
            Reply::Right => Ok(()),
            Reply::Declined => {
                report.skip(subject.name());
                Ok(())
            }
        });
        if let Err(finding) = compared {
            let (engine, mode) = (subject.engine(), form.mode());
            let replay = "pairmask-lab stress --case";
            let replay = format!("{replay} {} --engine {engine} --mode {mode}", case.seed);
            report.fail(Failure::new(case, form, subject.name().to_owned(), replay, finding));
        }
    }
}

#[cfg(test)]
mod tests;
