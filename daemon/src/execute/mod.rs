//! Engines of the daemon: those of the client library, and the GPU.

pub mod gpu;
mod gpu_service;

pub use gpu_service::{GpuService, Owner};

use std::time::Instant;

use pairmask::engine::{
    CpuEngines, CullAnswer, CullError, CullJob, CullWish, EngineChoice, EngineName, ReplyBuffer,
};
use pairmask::wire::StageTimes;
use pairmask::{Aabb, BoxCount};

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
    /// is the same.
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
        let EngineChoice::Only(EngineName::GpuBrute) = wish.engine else {
            return self.cpu.cull(boxes, wish, reply);
        };
        let gpu = self.gpu.as_mut().ok_or(CullError::Unavailable {
            engine: EngineName::GpuBrute,
            why: "this daemon has no GPU (see `pairmaskd serve --gpu`)",
        })?;
        let start = Instant::now();
        let n = BoxCount::of_len(boxes.len()).unwrap_or(BoxCount::new(u32::MAX));
        let job =
            CullJob { encoding: pairmask::engine::choose_encoding(wish.encoding, n), threads: 1 };
        match gpu.cull(boxes, owner, &job, reply) {
            Ok(report) => Ok(CullAnswer {
                engine: EngineName::GpuBrute,
                threads: 1,
                report,
                times: StageTimes {
                    ingest_ns: report.times.ingest_ns,
                    plan_ns: 0,
                    execute_ns: report.times.execute_ns,
                    publish_ns: report.times.publish_ns,
                    total_ns: start.elapsed().as_nanos() as u64,
                },
            }),
            Err(CullError::DeviceLost { .. } | CullError::DeviceMemory { .. }) => {
                let wish = CullWish { engine: EngineChoice::Auto, ..*wish };
                self.cpu.cull(boxes, &wish, reply)
            }
            Err(error) => Err(error),
        }
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        if let Some(gpu) = &mut self.gpu {
            gpu.tidy();
        }
    }
}
