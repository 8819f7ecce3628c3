//! Engines of the daemon: those of the client library, and the GPU.

pub mod gpu;
mod gpu_service;

pub use gpu_service::{GpuService, Owner};

use std::time::Instant;

use pairmask::Aabb;
use pairmask::engine::{
    CpuEngines, CullAnswer, CullError, CullWish, EngineChoice, ReplyBuffer, nanoseconds_since,
};

/// All engines that this daemon has.
pub struct Executor {
    cpu: CpuEngines,
    gpu: Option<GpuService>,
}

impl Executor {
    /// The CPU engines, and the GPU's if there is one.
    pub fn new(gpu: Option<GpuService>) -> Self {
        Self { cpu: CpuEngines::new(), gpu }
    }

    /// The GPU, if this daemon has one.
    pub fn gpu(&mut self) -> Option<&mut GpuService> {
        self.gpu.as_mut()
    }

    /// Plans a frame of boxes that belong to `owner`, and finds its pairs.
    ///
    /// A GPU that is lost, or has no memory for the scene, leaves the frame to the CPU: the answer
    /// is the same. A scene that crowds the GPU's grid goes to all pairs.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        owner: Owner,
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let gpu_cost = self.gpu.as_ref().and_then(GpuService::cost);
        let mut plan = self.cpu.plan(boxes, wish, gpu_cost);
        let plan_ns = nanoseconds_since(start);
        if plan.engine.is_gpu() {
            let done = match &mut self.gpu {
                Some(gpu) => gpu.cull(boxes, owner, &plan, reply),
                None => Err(CullError::Unavailable {
                    engine: plan.engine,
                    why: "this daemon has no GPU (see `pairmaskd serve --gpu`)",
                }),
            };
            match done {
                Err(
                    CullError::DeviceLost { .. }
                    | CullError::DeviceMemory { .. }
                    | CullError::TooCrowded { .. },
                ) => {
                    let wish = CullWish { engine: EngineChoice::Auto, ..*wish };
                    plan = self.cpu.plan(boxes, &wish, None);
                }
                done => {
                    let (report, engine) = done?;
                    plan.engine = engine;
                    return Ok(CullAnswer::new(&plan, report, start, plan_ns));
                }
            }
        }
        let report = self.cpu.run(&plan, boxes, reply)?;
        Ok(CullAnswer::new(&plan, report, start, plan_ns))
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        if let Some(gpu) = &mut self.gpu {
            gpu.tidy();
        }
    }
}
