//! The CPU's part of an executor: plans frames, and runs those that no GPU takes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::aabb::AABB_BYTES;
use pairmask_core::dispatch::{CpuEngines, CullAnswer, CullOptions, nanoseconds_since};
use pairmask_core::engine::{CullError, CullReport, RecentNeed, ReplyBuffer};
use pairmask_core::objects::Objects;
use pairmask_core::plan::{GpuCost, Plan};
use pairmask_core::precision::{BoxSlice, ExpandScratch};
use pairmask_core::repeat::is_sooner_compared;
use pairmask_core::{BoxForm, EngineChoice, EngineName};

use super::shared_gpu::SharedGpu;

/// The CPU engines, which take f32 boxes.
#[derive(Default)]
pub(super) struct CpuSide {
    pub engines: CpuEngines,
    pub expanded: ExpandScratch,
    expanded_need: RecentNeed,
}

impl CpuSide {
    pub fn with_engines(self, engines: CpuEngines) -> Self {
        Self { engines, ..self }
    }

    pub fn plan(
        &mut self,
        boxes: BoxSlice<'_>,
        options: &CullOptions,
        gpu: Option<GpuCost>,
    ) -> Planned {
        let start = Instant::now();
        let plan = self.engines.plan(boxes, options, gpu);
        let plan_ns = nanoseconds_since(start);
        log::debug!("{}", plan.explain());
        let one_core_ns = (plan.threads > 1 || plan.engine.is_gpu()).then(|| {
            let one_core =
                self.engines.plan(boxes, &CullOptions { threads: Some(1), ..*options }, None);
            one_core.expected_ns()
        });
        Planned { plan, options: *options, start, plan_ns, one_core_ns, gpu: None }
    }

    /// Runs a plan for a CPU engine. Expanding narrow boxes counts as ingest.
    pub fn run(
        &mut self,
        planned: Planned,
        boxes: BoxSlice<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let (engines, boxes, expand_ns) = self.expand(boxes, &planned.options);
        let (engine, mut report) = engines.run_plan(&planned.plan, boxes, reply)?;
        report.times.ingest_ns += expand_ns;
        Ok(planned.answer(report, engine))
    }

    /// The engines, f32 boxes for them, and the time that expanding took.
    pub fn expand<'s: 'b, 'b>(
        &'s mut self,
        boxes: BoxSlice<'b>,
        options: &CullOptions,
    ) -> (&'s mut CpuEngines, BoxSlice<'b>, u64) {
        let start = Instant::now();
        let expanded = if boxes.form() == BoxForm::F32 { 0 } else { AABB_BYTES * boxes.len() };
        if self.expanded_need.note(expanded, || self.expanded.allocated_bytes()) {
            self.expanded = ExpandScratch::default();
        }
        let boxes = boxes.expand(&mut self.expanded, options.threads != Some(1));
        (&mut self.engines, boxes, nanoseconds_since(start))
    }

    /// The answer to a frame that the GPU could not serve, or the error.
    pub fn run_after(
        &mut self,
        error: CullError,
        mut planned: Planned,
        boxes: BoxSlice<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        if !is_left_to_cores(&error) {
            return Err(error);
        }
        if let CullError::TooCrowded { engine } = error {
            self.engines.note_crowded(boxes.len(), engine);
        }
        let options = CullOptions { engine: EngineChoice::Auto, ..planned.options };
        planned.plan = self.engines.plan(boxes, &options, None);
        self.run(planned, boxes, reply)
    }
}

pub(crate) const fn is_left_to_cores(error: &CullError) -> bool {
    use CullError::{DeviceLost, DeviceMemory, TooCrowded};
    matches!(error, DeviceLost { .. } | DeviceMemory { .. } | TooCrowded { .. })
}

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
    pub fn gpu_index(&self) -> usize {
        self.gpu.as_ref().map_or(0, |gpu| gpu.number)
    }

    /// The predicted time on one core, where the plan has several threads of the CPU.
    pub fn on_one_core(&self) -> Option<Duration> {
        let is_gpu = self.plan.engine.is_gpu();
        self.one_core_ns.filter(|_| !is_gpu).map(Duration::from_nanos)
    }

    pub fn is_gpu(&self) -> bool {
        self.plan.engine.is_gpu()
    }

    /// Whether the plan is a GPU's, and a core is predicted to take much longer than a GPU that others
    /// wait for too, or cannot serve the frame at all.
    pub fn needs_gpu(&self) -> bool {
        let on_core = self.one_core_ns.filter(|ns| *ns > 0).map(Duration::from_nanos);
        self.plan.engine.is_gpu() && on_core.is_none_or(|on_core| on_core > LEFT_TO_CORES)
    }

    /// Whether comparing its boxes with those of a frame before is sooner than culling them.
    pub fn is_sooner_compared(&self, objects: Objects<'_>) -> bool {
        let threads = self.options.threads.unwrap_or(1);
        let engine_ns = self.plan.expected_ns();
        !self.plan.engine.is_gpu() || is_sooner_compared(objects, threads, engine_ns)
    }

    /// The answer of `engine`, which need not be the plan's.
    pub(super) fn answer(mut self, report: CullReport, engine: EngineName) -> CullAnswer {
        self.plan.engine = engine;
        CullAnswer::new(&self.plan, report, self.start, self.plan_ns)
    }
}

/// Beside others, frames that take a core up to so long stay there: cores work side by side, and the GPU
/// is left to those who need it (4 clients of 10,000 boxes beside 4 of 3,000 on an H200). Longer ones wait
/// for the GPU: a core beside busy clients takes twice what it would alone.
const LEFT_TO_CORES: Duration = Duration::from_micros(200);
