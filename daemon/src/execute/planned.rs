//! A frame with its plan: what the lanes ask of it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullAnswer, CullOptions};
use pairmask_core::engine::{CullReport, EngineName};
use pairmask_core::objects::Objects;
use pairmask_core::plan::Plan;
use pairmask_core::repeat::is_sooner_compared;

use super::shared_gpu::SharedGpu;

/// A frame with its plan.
#[derive(Debug)]
pub struct Planned {
    pub(super) plan: Plan,
    pub(super) options: CullOptions,
    pub(super) start: Instant,
    pub(super) plan_ns: u64,
    pub(super) one_core_ns: Option<u64>,
    /// The GPU that the plan counts on, and that takes the frame where the plan is a GPU's.
    pub(super) gpu: Option<Arc<SharedGpu>>,
}

impl Planned {
    /// The place of the GPU that takes the frame, among those of the daemon.
    pub fn gpu_place(&self) -> usize {
        self.gpu.as_ref().map_or(0, |gpu| gpu.number())
    }

    /// What the frame is predicted to take on one core, where the plan has several threads; `None` where
    /// it has one, or a GPU.
    pub fn on_one_core(&self) -> Option<Duration> {
        let is_gpu = self.plan.engine.is_gpu();
        self.one_core_ns.filter(|_| !is_gpu).map(Duration::from_nanos)
    }

    /// Whether the plan is a GPU's.
    pub fn is_gpu(&self) -> bool {
        self.plan.engine.is_gpu()
    }

    /// Whether the plan is a GPU's, and a core is predicted to take much longer than a GPU that others
    /// wait for too, or cannot serve the frame at all.
    pub fn needs_gpu(&self) -> bool {
        let on_core = self.one_core_ns.filter(|ns| *ns > 0).map(Duration::from_nanos);
        self.plan.engine.is_gpu() && on_core.is_none_or(|on_core| on_core > LEFT_TO_CORES)
    }

    /// Whether its boxes are compared with those of a frame before sooner than they are culled: always,
    /// unless a GPU culls them.
    pub fn is_sooner_compared(&self, objects: Objects<'_>) -> bool {
        let threads = self.options.threads.unwrap_or(1);
        let engine_ns = engine_ns(&self.plan);
        !self.plan.engine.is_gpu() || is_sooner_compared(objects, threads, engine_ns)
    }

    /// The answer of `engine`, which need not be the plan's.
    pub(super) fn answer(mut self, report: CullReport, engine: EngineName) -> CullAnswer {
        self.plan.engine = engine;
        CullAnswer::new(&self.plan, report, self.start, self.plan_ns)
    }
}

/// Predicted time of a plan without the client's part, ns.
pub(super) fn engine_ns(plan: &Plan) -> u64 {
    let chosen = plan.candidates.iter().flatten().find(|c| c.engine == plan.engine);
    chosen.map_or(0.0, |c| c.predicted_ns - c.visit_ns) as u64
}

/// Beside others, frames that take a core up to so long stay there: cores work side by side, and the GPU
/// is left to those who need it (4 clients of 10,000 boxes beside 4 of 3,000 on an H200). Longer ones wait
/// for the GPU: a core beside busy clients takes twice what it would alone.
const LEFT_TO_CORES: Duration = Duration::from_micros(200);
