//! Judges the plan's choice: the planned way beside the fastest measured one.

use crate::study::ways::{Case, CaseTimes, Way};
use pairmask_core::dispatch::CullOptions;
use pairmask_core::plan::{Calibration, Capabilities, Plan, plan};

/// A judged plan.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The case.
    pub case: Case,
    /// Threads that the plan could use.
    pub threads: usize,
    /// The way that it chose.
    pub planned: Way,
    /// The fastest way.
    pub best: Way,
    /// Time of the planned way, ns.
    pub planned_ns: u64,
    /// Predicted time of the planned way, ns.
    pub predicted_ns: f64,
    /// Time of the fastest way, ns.
    pub best_ns: u64,
    /// Time of planning, ns.
    pub plan_ns: u64,
}

impl Judgement {
    /// Planning and the planned way together, over the fastest way without planning.
    pub fn ratio(&self) -> f64 {
        (self.planned_ns + self.plan_ns) as f64 / self.best_ns.max(1) as f64
    }
}

/// Judges the plan of a measured case with a number of threads.
///
/// `None` where the planned way was not measured because its prediction was hopeless. A plan must
/// not choose such a way, so callers count it as a miss.
pub fn judge(measured: &CaseTimes, threads: usize, calibration: &Calibration) -> Option<Judgement> {
    let capabilities = Capabilities { threads, gpu: None };
    let plan: Plan = plan(&measured.stats, &capabilities, calibration, &CullOptions::default());
    let allowed = measured.ways.iter().filter(|(way, _)| way.threads <= threads);
    let (best, best_times) = allowed.min_by_key(|(_, times)| times.least_ns())?;
    let planned = Way { engine: plan.engine, encoding: plan.encoding, threads: plan.threads };
    let (_, planned_times) = measured.ways.iter().find(|(way, _)| *way == planned)?;
    let candidate = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine)?;
    Some(Judgement {
        case: measured.case,
        threads,
        planned,
        best: *best,
        planned_ns: planned_times.least_ns(),
        predicted_ns: candidate.predicted_ns,
        best_ns: best_times.least_ns(),
        plan_ns: measured.plan_ns,
    })
}
