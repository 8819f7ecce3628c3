//! Engines of the daemon: those of the client library, and the GPU.

mod cpu_side;
mod engine_pool;
mod frame_memory;
pub mod gpu;
mod gpu_service;
mod gpus;
mod ruled;
mod scene_host;
mod shared_gpu;
mod spheres;
mod turns;

pub use self::cpu_side::Planned;
pub(crate) use self::cpu_side::is_left_to_cores;
pub(crate) use self::engine_pool::used_by;
pub use self::engine_pool::{CpuTimer, EnginePool};
pub use self::frame_memory::FrameMemory;
pub(crate) use self::frame_memory::boxes_of;
pub use self::gpu::{BUNDLE_FRAMES, Owner, SUBMISSIONS};
pub use self::gpu_service::{GpuService, WatchDevice};
pub use self::gpus::{Gpus, SceneGpus};
pub use self::ruled::RuledFrame;
pub use self::scene_host::SceneHost;
pub use self::shared_gpu::{CullUnderWay, Ended, Joining, SharedGpu, Unserved};

use std::sync::{Arc, atomic};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CpuEngines, CullAnswer, CullOptions, SphereWays};
use pairmask_core::engine::{AvailableIsa, CullError, CullReport, RecentNeed, ReplyBuffer};
use pairmask_core::objects::Objects;
use pairmask_core::plan::{Calibration, Capabilities, GpuCost, Plan, SceneStats, plan};
use pairmask_core::precision::{BoxSlice, ExpandScratch};
use pairmask_core::repeat::{KeepTicket, Repeats};
use pairmask_core::{BoxCount, Encoding, EngineChoice, EngineName};
use pairmask_wire::RulesReader;

use self::cpu_side::CpuSide;
use self::frame_memory::{LentReply, with_lent};
use self::gpu::Gpu;
use self::ruled::CachedMarks;

/// CPU engines of a session, with their state, and the GPU, which all sessions share.
pub struct Executor {
    cpu: CpuSide,
    spheres: SphereWays,
    spheres_need: RecentNeed,
    repeats: Repeats,
    rules: RulesReader,
    marks: CachedMarks,
    gpus: Gpus,
    /// The place of the GPU that its frames go to while others are no better.
    home: usize,
    isa: AvailableIsa,
    calibration: Calibration,
    /// When the last frame began, until its scratch is given back.
    last_frame: Option<Instant>,
}

/// The error of a frame for which an engine of the GPU is asked.
const fn no_gpu(engine: EngineName) -> CullError {
    CullError::Unavailable { engine, why: "this daemon has no GPU (see `pairmaskd serve --gpu`)" }
}

/// Time without a frame after which the engines' scratch is given back: longer than a game's
/// menus or a level that loads. The frame after takes a few ms longer.
const IDLE: Duration = Duration::from_secs(10);

impl Executor {
    pub fn new(gpus: impl IntoIterator<Item = GpuService>) -> Self {
        Self::with_gpus(Gpus::new(gpus))
    }

    fn with_gpus(gpus: Gpus) -> Self {
        Self {
            cpu: CpuSide::default(),
            spheres: SphereWays::default(),
            spheres_need: RecentNeed::default(),
            repeats: Repeats::default(),
            rules: RulesReader::default(),
            marks: CachedMarks::default(),
            home: gpus.next_home(),
            gpus,
            isa: AvailableIsa::best(),
            calibration: Calibration::built_in(AvailableIsa::best().get()),
            last_frame: None,
        }
    }

    /// The same with CPU engines that use `isa` and whose plans compute with `calibration`.
    #[must_use]
    pub fn with_engines(self, isa: AvailableIsa, calibration: Calibration) -> Self {
        let engines = CpuEngines::on(isa, calibration);
        let spheres = SphereWays::on(isa);
        Self { cpu: self.cpu.with_engines(engines), spheres, isa, calibration, ..self }
    }

    /// Engines of another session: the same, with no state yet, beside the same GPUs.
    #[must_use]
    pub fn beside(&self) -> Self {
        Self::with_gpus(self.gpus.clone()).with_engines(self.isa, self.calibration)
    }

    pub const fn cpu_settings(&self) -> (AvailableIsa, Calibration) {
        (self.isa, self.calibration)
    }

    /// The device of this session's GPU, if it is there.
    pub fn device(&self) -> Option<Arc<Gpu>> {
        self.gpus.device(self.home)
    }

    pub const fn gpus(&self) -> &Gpus {
        &self.gpus
    }

    /// Plans a frame of boxes that belong to `owner`, and finds its pairs. The GPU reads boxes in
    /// the form that they have; for a CPU engine narrow ones are expanded first, which counts as
    /// ingest.
    ///
    /// A GPU that is lost, or has no memory for the scene, leaves the frame to the CPU: the answer
    /// is the same. A scene that crowds the GPU's grid goes to all pairs. Where the client left the
    /// encoding open, a mask that fits into the reply in any encoding is found.
    pub fn cull(
        &mut self,
        boxes: BoxSlice<'_>,
        owner: Owner,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let planned = self.plan(boxes, options, reply.limit_words());
        self.run_or_other(planned, &mut Frame { objects: boxes.into(), owner, reply })
    }

    pub fn plan(
        &mut self,
        boxes: BoxSlice<'_>,
        options: &CullOptions,
        limit_words: u64,
    ) -> Planned {
        self.plan_within(boxes, &options.within(boxes.len(), limit_words))
    }

    /// The plan of a frame whose objects are not looked at.
    fn plan_unseen(&self, stats: &SceneStats, gpu: Option<GpuCost>, options: &CullOptions) -> Plan {
        let pool = rayon::current_num_threads();
        let threads = options.threads.unwrap_or(pool).clamp(1, pool);
        plan(stats, &Capabilities { threads, gpu }, &self.calibration, options)
    }

    /// As [`Self::plan`]. While other clients are busy, a frame that does not need the GPU gets a core.
    pub fn plan_beside(
        &mut self,
        others: bool,
        boxes: BoxSlice<'_>,
        options: &CullOptions,
        limit_words: u64,
    ) -> Planned {
        let planned = self.plan(boxes, options, limit_words);
        if !others
            || !planned.is_gpu()
            || planned.needs_gpu()
            || options.engine != EngineChoice::Auto
        {
            return planned;
        }
        let plan_ns = planned.plan_ns;
        let planned = self.cpu.plan(boxes, &options.within(boxes.len(), limit_words), None);
        Planned { plan_ns: planned.plan_ns + plan_ns, ..planned }
    }

    /// What is remembered of the session's last frame.
    pub fn repeats(&mut self) -> &mut Repeats {
        // Who looks at a frame uses the engines.
        self.last_frame = Some(Instant::now());
        &mut self.repeats
    }

    /// Learns from a frame of so many boxes that a GPU answered.
    pub(crate) fn note_gpu(&mut self, n: BoxCount, answer: &CullAnswer) {
        self.cpu.engines.note_gpu(n, answer);
    }

    /// Where the objects and the answer of a frame are to be kept, if they are.
    pub fn ticket(&mut self, keeps: bool) -> Option<KeepTicket> {
        keeps.then(|| self.repeats().ticket()).flatten()
    }

    /// Whether a frame is better [begun](Self::begin) on the GPU than [waited for](Self::run).
    pub fn can_begin(&self, planned: &Planned) -> bool {
        let can_begin = |gpu: &Arc<SharedGpu>| gpu.outlook().can_begin(&planned.plan);
        planned.gpu.as_ref().is_some_and(can_begin)
    }

    /// Whether a frame is so small that it may [join](Self::join) others in a submission.
    pub fn can_join(&self, planned: &Planned) -> bool {
        let Planned { plan, options, gpu, .. } = planned;
        let is_grid =
            matches!(options.engine, EngineChoice::Auto) || plan.engine == EngineName::GpuGrid;
        is_grid && gpu.as_ref().is_some_and(|gpu| gpu.outlook().can_join(plan))
    }

    /// Has a frame wait for others, to be submitted with them ([`SharedGpu::begin_bundle`]).
    pub fn join<M: FrameMemory>(mut planned: Planned, owner: Owner, memory: M) -> Joining<M> {
        planned.plan.engine = EngineName::GpuGrid;
        Joining { planned, owner, memory }
    }

    /// Runs a plan for the boxes of this memory, which belong to `owner`, as [`Self::cull`].
    pub fn run<M: FrameMemory>(
        &mut self,
        planned: Planned,
        owner: Owner,
        memory: &mut M,
    ) -> Result<CullAnswer, CullError> {
        let gpu = planned.gpu.clone();
        offering_reply(gpu.as_ref(), memory, |objects, reply| {
            self.run_or_other(planned, &mut Frame { objects, owner, reply })
        })
    }

    /// Leaves a frame of memory whose boxes belong to `owner` to the GPU. Where nothing is under way, the
    /// error has its answer, or that of all engines.
    #[allow(clippy::result_large_err)] // A box would be an allocation.
    pub fn begin<M: FrameMemory>(
        &mut self,
        planned: Planned,
        owner: Owner,
        mut memory: M,
    ) -> Result<CullUnderWay<M>, Ended<M>> {
        let Some(gpu) = planned.gpu.clone() else {
            return Err((self.run(planned, owner, &mut memory), Some(memory)));
        };
        let queued = gpu.queue(&planned.plan, 1);
        match gpu.with(|gpu| gpu.begin(memory, owner, &planned.plan)) {
            Ok(frame) => Ok(CullUnderWay { frame, owner, planned, queued }),
            Err((error, memory)) => Err(self.answer(Unserved { error, planned, owner, memory })),
        }
    }

    pub fn end<M: FrameMemory>(&mut self, cull: CullUnderWay<M>) -> Ended<M> {
        cull.end().unwrap_or_else(|unserved| self.answer(unserved))
    }

    /// Answers a frame that the GPU could not serve, where its memory is there.
    pub fn answer<M: FrameMemory>(&mut self, unserved: Unserved<M>) -> Ended<M> {
        let Unserved { error, planned, owner, memory } = unserved;
        let Some(mut memory) = memory else { return (Err(error), None) };
        let (options, tried) = (planned.options, planned.plan.encoding);
        let answer = memory.with(|objects, reply| {
            let frame = &mut Frame { objects, owner, reply };
            let done = self.run_elsewhere(error, planned, frame);
            done.or_else(|error| self.run_other(error, options, tried, frame))
        });
        (answer, Some(memory))
    }

    /// Gives scratch memory up where no frame has come for long; to be called now and then.
    pub fn tidy(&mut self) {
        if self.last_frame.take_if(|last| last.elapsed() >= IDLE).is_some() {
            self.give_back();
        }
    }

    /// Gives the scratch of the CPU engines back. Answers do not depend on it.
    pub fn give_back(&mut self) {
        self.cpu.engines.give_back();
        self.cpu.expanded = ExpandScratch::default();
        self.spheres = SphereWays::default();
        self.repeats.discard();
        self.rules.give_back();
        self.marks = CachedMarks::default();
    }

    /// Bytes of scratch that the CPU engines keep from frame to frame, beside boxes and replies.
    pub fn scratch_bytes(&self) -> usize {
        self.cpu.engines.scratch_bytes()
            + self.cpu.expanded.allocated_bytes()
            + self.spheres.scratch_bytes()
            + self.repeats.allocated_bytes()
            + self.rules.allocated_bytes()
    }

    fn plan_within(&mut self, boxes: BoxSlice<'_>, options: &CullOptions) -> Planned {
        let gpu = self.gpus.for_frame(self.home).cloned();
        let cost = gpu.as_ref().and_then(|gpu| gpu.cost());
        let planned = Planned { gpu, ..self.cpu.plan(boxes, options, cost) };
        self.last_frame = Some(planned.start);
        if self.spheres_need.note(0, || self.spheres.scratch_bytes()) {
            self.spheres = SphereWays::default();
        }
        planned
    }

    /// The mask in another encoding than one that does not fit, where that is open; else the error.
    fn run_other(
        &mut self,
        error: CullError,
        options: CullOptions,
        tried: Encoding,
        frame: &mut Frame<'_>,
    ) -> Result<CullAnswer, CullError> {
        let (boxes, limit_words) = (frame.boxes(), frame.reply.limit_words());
        let Some(other) = options.after(tried, &error, boxes.len(), limit_words) else {
            return Err(error);
        };
        let planned = self.plan_within(boxes, &other);
        self.run_once(planned, frame)
    }

    fn run_or_other(
        &mut self,
        planned: Planned,
        frame: &mut Frame<'_>,
    ) -> Result<CullAnswer, CullError> {
        let (options, tried) = (planned.options, planned.plan.encoding);
        let done = self.run_once(planned, frame);
        done.or_else(|error| self.run_other(error, options, tried, frame))
    }

    fn run_once(
        &mut self,
        planned: Planned,
        frame: &mut Frame<'_>,
    ) -> Result<CullAnswer, CullError> {
        let engine = planned.plan.engine;
        if !engine.is_gpu() {
            return self.cpu.run(planned, frame.boxes(), frame.reply);
        }
        let gpu = planned.gpu.as_ref().ok_or(no_gpu(engine))?;
        match frame.cull_on(gpu, &planned.plan) {
            Ok((report, engine)) => Ok(planned.answer(report, engine)),
            Err(error) => self.run_elsewhere(error, planned, frame),
        }
    }

    /// The answer of another GPU where this one is lost, or of the CPU; else the error.
    fn run_elsewhere(
        &mut self,
        error: CullError,
        planned: Planned,
        frame: &mut Frame<'_>,
    ) -> Result<CullAnswer, CullError> {
        let lost = planned.gpu.as_ref().filter(|_| matches!(error, CullError::DeviceLost { .. }));
        let other = lost.and_then(|lost| self.gpus.beside(lost));
        let done = other.map_or(Err(error), |other| frame.cull_on(other, &planned.plan));
        match done {
            Ok((report, engine)) => Ok(planned.answer(report, engine)),
            Err(error) => self.cpu.run_after(error, planned, frame.boxes(), frame.reply),
        }
    }
}

/// Answers a frame of memory. Where a GPU did, the reply is imported, so that it writes the next one without a copy.
fn offering_reply<M: FrameMemory>(
    gpu: Option<&Arc<SharedGpu>>,
    memory: &mut M,
    work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> Result<CullAnswer, CullError>,
) -> Result<CullAnswer, CullError> {
    let mut lent = LentReply::default();
    let answer = with_lent(memory, &mut lent, work)?;
    if let Some(gpu) = gpu.filter(|_| answer.engine.is_gpu()) {
        gpu.with(|gpu| gpu.offer_reply(lent));
    }
    Ok(answer)
}

struct Frame<'a> {
    objects: Objects<'a>,
    owner: Owner,
    reply: &'a mut dyn ReplyBuffer,
}

impl<'a> Frame<'a> {
    fn boxes(&self) -> BoxSlice<'a> {
        boxes_of(self.objects)
    }

    fn cull_on(
        &mut self,
        gpu: &SharedGpu,
        plan: &Plan,
    ) -> Result<(CullReport, EngineName), CullError> {
        gpu.check_opened(plan.engine)?;
        let _queued = gpu.queue(plan, 1);
        gpu.with(|gpu| gpu.cull(self.objects, self.owner, plan, self.reply))
    }
}
