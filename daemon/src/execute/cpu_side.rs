//! The CPU's part of an executor: plans frames, and runs those that no GPU takes.

use std::time::Instant;

use pairmask_core::BoxForm;
use pairmask_core::aabb::AABB_BYTES;
use pairmask_core::dispatch::{CpuEngines, CullAnswer, CullOptions, nanoseconds_since};
use pairmask_core::engine::{CullError, EngineChoice, RecentNeed, ReplyBuffer};
use pairmask_core::plan::GpuCost;
use pairmask_core::precision::{BoxSlice, ExpandScratch};

use super::planned::{Planned, engine_ns};

/// The CPU engines, which take f32 boxes.
#[derive(Default)]
pub(super) struct CpuSide {
    pub engines: CpuEngines,
    /// Those of frames that came in a narrow form.
    pub expanded: ExpandScratch,
    expanded_need: RecentNeed,
}

impl CpuSide {
    /// The same with other engines.
    pub fn with_engines(self, engines: CpuEngines) -> Self {
        Self { engines, ..self }
    }

    /// Begins a frame with its plan.
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
            engine_ns(&one_core)
        });
        Planned { plan, options: *options, start, plan_ns, one_core_ns, gpu: None }
    }

    /// Runs a plan for a CPU engine. Boxes in a narrow form are expanded first, which counts as
    /// ingest.
    pub fn run(
        &mut self,
        planned: Planned,
        boxes: BoxSlice<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        self.note_expanded(boxes);
        let boxes = boxes.expand(&mut self.expanded, planned.options.threads != Some(1));
        let expand_ns = nanoseconds_since(start);
        let mut report =
            self.engines.run(planned.plan.engine, &planned.plan.input(boxes), reply)?;
        report.times.ingest_ns += expand_ns;
        let engine = planned.plan.engine;
        Ok(planned.answer(report, engine))
    }

    /// Gives memory for expanded boxes back where frames of the past needed much more.
    pub fn note_expanded(&mut self, boxes: BoxSlice<'_>) {
        let expanded = if boxes.form() == BoxForm::F32 { 0 } else { AABB_BYTES * boxes.len() };
        if self.expanded_need.note(expanded, || self.expanded.allocated_bytes()) {
            self.expanded = ExpandScratch::default();
        }
    }

    /// The answer to a frame that the GPU could not serve, or the error.
    pub fn run_after(
        &mut self,
        error: CullError,
        mut planned: Planned,
        boxes: BoxSlice<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        match error {
            CullError::DeviceLost { .. }
            | CullError::DeviceMemory { .. }
            | CullError::TooCrowded { .. } => {
                let options = CullOptions { engine: EngineChoice::Auto, ..planned.options };
                planned.plan = self.engines.plan(boxes, &options, None);
                self.run(planned, boxes, reply)
            }
            error => Err(error),
        }
    }
}
