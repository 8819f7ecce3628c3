//! What comes of a frame.

use std::time::Instant;

use crate::engine::{CullReport, EngineName, EngineTimes};
use crate::plan::Plan;

/// Time of a frame's stages in the daemon or in process, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimes {
    /// Boxes read and turned into the engine's form.
    pub ingest_ns: u64,
    /// Plan made.
    pub plan_ns: u64,
    /// Pairs tested.
    pub execute_ns: u64,
    /// Mask written.
    pub publish_ns: u64,
    /// From the request in hand to the response ready to be sent. At least the sum of the stages.
    pub total_ns: u64,
}

impl StageTimes {
    /// Those of an engine for a frame that was begun at `start`, and whose plan took `plan_ns`.
    pub fn new(engine: EngineTimes, plan_ns: u64, start: Instant) -> Self {
        let EngineTimes { ingest_ns, execute_ns, publish_ns } = engine;
        Self { ingest_ns, plan_ns, execute_ns, publish_ns, total_ns: nanoseconds_since(start) }
    }
}

/// An answered cull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullAnswer {
    /// Which engine answered.
    pub engine: EngineName,
    /// Threads that it could use.
    pub threads: usize,
    /// What it says of the frame.
    pub report: CullReport,
    /// Time by stage.
    pub times: StageTimes,
    /// What the plan expected the engine to take, without the client's part; 0 where there was no plan.
    pub expected_ns: u64,
}

impl CullAnswer {
    /// The answer of an engine to a plan that was begun at `start` and took `plan_ns`.
    pub fn new(plan: &Plan, report: CullReport, start: Instant, plan_ns: u64) -> Self {
        Self {
            engine: plan.engine,
            threads: plan.threads,
            report,
            times: StageTimes::new(report.times, plan_ns, start),
            expected_ns: plan.expected_ns(),
        }
    }
}

/// Nanoseconds since `start`; u64 holds 584 years of them.
pub fn nanoseconds_since(start: Instant) -> u64 {
    start.elapsed().as_nanos() as u64
}
