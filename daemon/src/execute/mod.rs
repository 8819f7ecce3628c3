//! Engines of the daemon: those of the client library, and the GPU.

pub mod gpu;
mod gpu_service;
mod spheres;

pub use gpu_service::{GpuFrame, GpuService, Owner};

use std::time::Instant;

use pairmask::Aabb;
use pairmask::engine::{
    CpuEngines, CullAnswer, CullError, CullReport, CullWish, EngineChoice, EngineName, ReplyBuffer,
    nanoseconds_since,
};
use pairmask::plan::{Calibration, Plan};
use pairmask::precision::{ExpandScratch, NarrowBoxes};
use pairmask::sphere::SphereWays;

/// A frame with its plan.
#[derive(Debug)]
struct Planned {
    plan: Plan,
    wish: CullWish,
    start: Instant,
    expand_ns: u64,
    plan_ns: u64,
}

impl Planned {
    /// The answer of `engine`, which need not be the plan's.
    fn answer(mut self, report: CullReport, engine: EngineName) -> CullAnswer {
        self.plan.engine = engine;
        let mut answer = CullAnswer::new(&self.plan, report, self.start, self.plan_ns);
        answer.times.ingest_ns += self.expand_ns;
        answer
    }
}

/// A frame that was begun.
#[allow(clippy::large_enum_variant)] // A box would be an allocation in every frame.
#[derive(Debug)]
pub enum Started {
    /// And is done.
    Answered(CullAnswer),
    /// And is to be ended.
    UnderWay(CullUnderWay),
}

/// A frame that the GPU works on.
#[derive(Debug)]
pub struct CullUnderWay {
    frame: GpuFrame,
    planned: Planned,
}

/// Frames that may be under way at a time.
pub const FRAMES_UNDER_WAY: usize = gpu::device::LANES;

/// All engines that this daemon has.
pub struct Executor {
    cpu: CpuEngines,
    spheres: SphereWays,
    gpu: Option<GpuService>,
    /// Boxes that came in a narrow form, as the engines take them.
    expanded: ExpandScratch,
}

impl Executor {
    /// The CPU engines, and the GPU's if there is one.
    pub fn new(gpu: Option<GpuService>) -> Self {
        Self {
            cpu: CpuEngines::new(),
            spheres: SphereWays::default(),
            gpu,
            expanded: ExpandScratch::default(),
        }
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
    /// is the same. A scene that crowds the GPU's grid goes to all pairs.
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
        let Self { cpu, gpu, expanded, .. } = self;
        let owner = if boxes.form().is_narrow() { Owner::Scratch } else { owner };
        let start = Instant::now();
        let boxes = boxes.expand(expanded, wish.threads != Some(1));
        let planned = plan(cpu, gpu.as_ref(), boxes, wish, start);
        run(cpu, gpu.as_mut(), planned, boxes, owner, reply)
    }

    /// As [`Self::cull`], but a frame that the GPU takes its time for may come back under way. Its
    /// boxes and its reply stay where they are until [`Self::end`], or until the executor is
    /// dropped.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn begin(
        &mut self,
        boxes: NarrowBoxes<'_>,
        owner: Owner,
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<Started, CullError> {
        if boxes.form().is_narrow() {
            // Expanded into memory that the next frame needs too.
            return self.cull(boxes, owner, wish, reply).map(Started::Answered);
        }
        let Self { cpu, gpu, expanded, .. } = self;
        let start = Instant::now();
        let boxes = boxes.expand(expanded, wish.threads != Some(1));
        let planned = plan(cpu, gpu.as_ref(), boxes, wish, start);
        if let Some(gpu) = gpu.as_mut().filter(|gpu| gpu.can_begin(&planned.plan)) {
            return match gpu.begin(boxes, owner, &planned.plan, reply) {
                Ok(frame) => Ok(Started::UnderWay(CullUnderWay { frame, planned })),
                Err(error) => run_after(cpu, error, planned, boxes, reply).map(Started::Answered),
            };
        }
        run(cpu, gpu.as_mut(), planned, boxes, owner, reply).map(Started::Answered)
    }

    /// Whether a frame has ended, so that [`Self::end`] does not wait.
    pub fn has_ended(&self, cull: &CullUnderWay) -> bool {
        self.gpu.as_ref().is_none_or(|gpu| gpu.has_ended(&cull.frame))
    }

    /// Waits for a frame. `boxes` and `reply` are those that it began with.
    ///
    /// # Errors
    /// [`CullError`].
    pub fn end(
        &mut self,
        cull: CullUnderWay,
        boxes: NarrowBoxes<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let CullUnderWay { frame, planned } = cull;
        let Self { cpu, gpu, expanded, .. } = self;
        let boxes = boxes.expand(expanded, false);
        let lost = CullError::DeviceLost { engine: planned.plan.engine };
        let done = match gpu {
            Some(gpu) => gpu.end(&frame, boxes, &planned.plan, reply),
            None => Err(lost),
        };
        match done {
            Ok((report, engine)) => Ok(planned.answer(report, engine)),
            Err(error) => run_after(cpu, error, planned, boxes, reply),
        }
    }

    /// Lets the GPU work for a moment.
    pub fn rest(&mut self) {
        if let Some(gpu) = &mut self.gpu {
            gpu.rest();
        }
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        if let Some(gpu) = &mut self.gpu {
            gpu.tidy();
        }
    }
}

/// The plan of a frame that was begun at `start` and whose boxes are expanded.
fn plan(
    cpu: &CpuEngines,
    gpu: Option<&GpuService>,
    boxes: &[Aabb],
    wish: &CullWish,
    start: Instant,
) -> Planned {
    let expand_ns = nanoseconds_since(start);
    let plan = cpu.plan(boxes, wish, gpu.and_then(GpuService::cost));
    let plan_ns = nanoseconds_since(start) - expand_ns;
    log::debug!("{}", plan.explain());
    Planned { plan, wish: *wish, start, expand_ns, plan_ns }
}

fn run(
    cpu: &mut CpuEngines,
    gpu: Option<&mut GpuService>,
    planned: Planned,
    boxes: &[Aabb],
    owner: Owner,
    reply: &mut dyn ReplyBuffer,
) -> Result<CullAnswer, CullError> {
    let engine = planned.plan.engine;
    if !engine.is_gpu() {
        let report = cpu.run(&planned.plan, boxes, reply)?;
        return Ok(planned.answer(report, engine));
    }
    let done = match gpu {
        Some(gpu) => gpu.cull(boxes, owner, &planned.plan, reply),
        None => Err(CullError::Unavailable {
            engine,
            why: "this daemon has no GPU (see `pairmaskd serve --gpu`)",
        }),
    };
    match done {
        Ok((report, engine)) => Ok(planned.answer(report, engine)),
        Err(error) => run_after(cpu, error, planned, boxes, reply),
    }
}

/// The CPU's answer to a frame that the GPU could not serve, or the error.
fn run_after(
    cpu: &mut CpuEngines,
    error: CullError,
    mut planned: Planned,
    boxes: &[Aabb],
    reply: &mut dyn ReplyBuffer,
) -> Result<CullAnswer, CullError> {
    match error {
        CullError::DeviceLost { .. }
        | CullError::DeviceMemory { .. }
        | CullError::TooCrowded { .. } => {
            let wish = CullWish { engine: EngineChoice::Auto, ..planned.wish };
            planned.plan = cpu.plan(boxes, &wish, None);
            let report = cpu.run(&planned.plan, boxes, reply)?;
            let engine = planned.plan.engine;
            Ok(planned.answer(report, engine))
        }
        error => Err(error),
    }
}
