//! Engines of the daemon: those of the client library, and the GPU.

pub mod gpu;
mod gpu_service;

pub use gpu_service::{GpuService, Owner};

use std::time::Instant;

use pairmask::engine::{
    CpuEngines, CullAnswer, CullError, CullWish, EngineChoice, ReplyBuffer, nanoseconds_since,
};
use pairmask::plan::{Calibration, Plan};
use pairmask::precision::{ExpandScratch, NarrowBoxes};

/// All engines that this daemon has.
pub struct Executor {
    cpu: CpuEngines,
    gpu: Option<GpuService>,
    /// Boxes that came in a narrow form, as the engines take them.
    expanded: ExpandScratch,
}

impl Executor {
    /// The CPU engines, and the GPU's if there is one.
    pub fn new(gpu: Option<GpuService>) -> Self {
        Self { cpu: CpuEngines::new(), gpu, expanded: ExpandScratch::default() }
    }

    /// The same engines, whose plans compute with `calibration`.
    #[must_use]
    pub fn with_calibration(self, calibration: Calibration) -> Self {
        Self { cpu: CpuEngines::with_calibration(calibration), ..self }
    }

    /// The GPU, if this daemon has one.
    pub fn gpu(&mut self) -> Option<&mut GpuService> {
        self.gpu.as_mut()
    }

    /// Plans a frame of boxes that belong to `owner`, and finds its pairs. Boxes in a narrow form
    /// are expanded first, which counts as ingest.
    ///
    /// A GPU that is lost, or has no memory for the scene, leaves the frame to the CPU: the answer
    /// is the same.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn cull(
        &mut self,
        boxes: NarrowBoxes<'_>,
        owner: Owner,
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let owner = if boxes.form().is_narrow() { Owner::Scratch } else { owner };
        let boxes = boxes.expand(&mut self.expanded, wish.threads != Some(1));
        let expand_ns = nanoseconds_since(start);
        let answered = |plan: &Plan, report, plan_ns| {
            let mut answer = CullAnswer::new(plan, report, start, plan_ns);
            answer.times.ingest_ns += expand_ns;
            answer
        };
        let gpu_cost = self.gpu.as_ref().and_then(GpuService::cost);
        let mut plan = self.cpu.plan(boxes, wish, gpu_cost);
        let plan_ns = nanoseconds_since(start) - expand_ns;
        log::debug!("{}", plan.explain());
        if plan.engine.is_gpu() {
            let done = match &mut self.gpu {
                Some(gpu) => gpu.cull(boxes, owner, &plan, reply),
                None => Err(CullError::Unavailable {
                    engine: plan.engine,
                    why: "this daemon has no GPU (see `pairmaskd serve --gpu`)",
                }),
            };
            match done {
                Err(CullError::DeviceLost { .. } | CullError::DeviceMemory { .. }) => {
                    let wish = CullWish { engine: EngineChoice::Auto, ..*wish };
                    plan = self.cpu.plan(boxes, &wish, None);
                }
                done => return Ok(answered(&plan, done?, plan_ns)),
            }
        }
        let report = self.cpu.run(&plan, boxes, reply)?;
        Ok(answered(&plan, report, plan_ns))
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        if let Some(gpu) = &mut self.gpu {
            gpu.tidy();
        }
    }
}
