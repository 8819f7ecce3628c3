//! The CPU engines of a process, kept warm, and the choice among them.

use std::time::Instant;

use super::{
    AvailableIsa, BruteForce, CullError, CullJob, CullReport, Engine, EngineChoice, EngineName,
    Grid, ReplyBuffer, SweepAndPrune,
};
use crate::aabb::Aabb;
use crate::mask::{EncodingChoice, ReadableEncodings};
use crate::plan::{Calibration, Capabilities, GpuCost, Plan, SceneStats, Wishes, plan};
use crate::precision::NarrowBoxes;
use crate::units::BoxCount;
use crate::wire::StageTimes;

/// What a client leaves open and what it insists on, and what is known of its last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullWish {
    /// Which engine.
    pub engine: EngineChoice,
    /// Which encoding.
    pub encoding: EncodingChoice,
    /// How many threads; `None` leaves it to the plan.
    pub threads: Option<usize>,
    /// Pairs of the client's last frame, for the plan. The answer does not depend on it.
    pub last_pairs: Option<u64>,
    /// Encodings that the client can read.
    pub readable: ReadableEncodings,
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
}

impl CullAnswer {
    /// The answer of an engine to a plan that was begun at `start` and took `plan_ns`.
    pub fn new(plan: &Plan, report: CullReport, start: Instant, plan_ns: u64) -> Self {
        Self {
            engine: plan.engine,
            threads: plan.threads,
            report,
            times: StageTimes {
                ingest_ns: report.times.ingest_ns,
                plan_ns,
                execute_ns: report.times.execute_ns,
                publish_ns: report.times.publish_ns,
                total_ns: nanoseconds_since(start),
            },
        }
    }
}

/// Nanoseconds since `start`; u64 holds 584 years of them.
pub fn nanoseconds_since(start: Instant) -> u64 {
    start.elapsed().as_nanos() as u64
}

/// All CPU engines, with the scratch memory and the order that they keep from frame to frame.
pub struct CpuEngines {
    brute_force: BruteForce,
    sweep_and_prune: SweepAndPrune,
    grid: Grid,
    calibration: Calibration,
}

impl Default for CpuEngines {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuEngines {
    /// Engines with empty scratch memory and the built-in calibration of this machine's
    /// instruction set.
    pub fn new() -> Self {
        Self::with_calibration(Calibration::built_in(AvailableIsa::best().get()))
    }

    /// Engines with empty scratch memory, whose plans compute with `calibration`.
    pub fn with_calibration(calibration: Calibration) -> Self {
        Self {
            brute_force: BruteForce::new(),
            sweep_and_prune: SweepAndPrune::new(),
            grid: Grid::new(),
            calibration,
        }
    }

    /// Bytes of scratch that all engines keep from frame to frame, beside boxes and replies.
    pub fn scratch_bytes(&self) -> usize {
        self.brute_force.scratch_bytes()
            + self.sweep_and_prune.scratch_bytes()
            + self.grid.scratch_bytes()
    }

    /// Plans a frame, among the CPU engines and a GPU if there is one. Boxes may be in any form: a
    /// few are looked at, and none is expanded.
    pub fn plan<'a>(
        &self,
        boxes: impl Into<NarrowBoxes<'a>>,
        wish: &CullWish,
        gpu: Option<GpuCost>,
    ) -> Plan {
        let boxes = boxes.into();
        let gpu = gpu.map(|cost| cost.of_form(boxes.form()));
        let pool = rayon::current_num_threads();
        let capabilities =
            Capabilities { threads: wish.threads.unwrap_or(pool).clamp(1, pool), gpu };
        let wishes =
            Wishes { engine: wish.engine, encoding: wish.encoding, readable: wish.readable };
        let stats = match (wish.engine, BoxCount::of_len(boxes.len())) {
            (EngineChoice::Only(engine), Some(n)) if engine.is_gpu() => {
                SceneStats::unseen(n, wish.last_pairs)
            }
            _ => SceneStats::glance(boxes, wish.last_pairs),
        };
        plan(&stats, &capabilities, &self.calibration, &wishes)
    }

    /// Runs a plan for a CPU engine.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn run(
        &mut self,
        plan: &Plan,
        boxes: &[Aabb],
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let job = CullJob { encoding: plan.encoding, threads: plan.threads };
        match plan.engine {
            EngineName::CpuBrute => self.brute_force.cull(boxes, &job, reply),
            EngineName::CpuSap => self.sweep_and_prune.cull(boxes, &job, reply),
            EngineName::CpuGrid => self.grid.cull(boxes, &job, reply),
            engine => Err(CullError::Unavailable { engine, why: "it needs a daemon with a GPU" }),
        }
    }

    /// Plans a frame among the CPU engines and finds its pairs.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let plan = self.plan(boxes, wish, None);
        let plan_ns = nanoseconds_since(start);
        let report = self.run(&plan, boxes, reply)?;
        Ok(CullAnswer::new(&plan, report, start, plan_ns))
    }
}
