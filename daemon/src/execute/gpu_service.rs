//! The GPU as the daemon uses it: opened once, its imports kept, replaced when lost.

use std::ops::Range;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{Marks, WorldRange, nanoseconds_since};
use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineChoice, HeapReply, ReplyBuffer,
};
use pairmask_core::objects::Objects;
use pairmask_core::plan::{GpuCost, Plan};
use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, Encoding, EngineName};

use super::frame_memory::{FrameMemory, LentReply, with_lent};
use super::gpu::{
    AllPairs, Awake, Begun, Block, EngineOptions, Gpu, GpuChoice, GpuError, GpuSlot, Grid,
    GridUnderWay, HostImport, IfMissing, Imports, Owner, SceneTools, SharedImports, SlotState,
    user_cache_folder,
};
use super::shared_gpu::Outlook;
use super::spheres::takes_spheres;

/// What is made on a device.
struct Engines {
    all_pairs: AllPairs,
    grid: Grid,
    /// What both find imported.
    imports: SharedImports,
    cost: Option<GpuCost>,
    awake: Option<Arc<Awake>>,
    scenes: Arc<SceneTools>,
}

impl Engines {
    fn new(gpu: &Arc<Gpu>, hold: Duration) -> Result<Self, GpuError> {
        let imports = SharedImports::default();
        let cache_folder = user_cache_folder();
        let options =
            EngineOptions { cache_folder, imports: imports.clone(), ..Default::default() };
        let awake = Awake::start(gpu, hold)?.map(Arc::new);
        let of_scenes = awake.as_ref().map(Arc::downgrade).unwrap_or_default();
        let mut engines = Self {
            all_pairs: AllPairs::new(gpu, options.clone())?,
            grid: Grid::new(gpu, &options)?,
            imports,
            cost: None,
            awake,
            scenes: SceneTools::kept_awake(gpu, &options, of_scenes)?,
        };
        engines.cost = measure(&mut engines, &EngineOptions { profiled: true, ..options });
        Ok(engines)
    }

    /// Runs the engine of a plan, or the one that can do what it cannot: all pairs, up to where cores take less time.
    fn cull(
        &mut self,
        objects: Objects<'_>,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(CullReport, EngineName), CullError> {
        // The plan was made without this device: it may have come while the frame waited.
        let is_software = self.grid.gpu().is_software();
        let takes = |engine| match objects {
            Objects::Spheres(these) if !takes_spheres(engine, these.len(), is_software) => {
                Err(CullError::TooCrowded { engine })
            }
            _ => Ok(()),
        };
        // A dense mask has a bit for all pairs, so all pairs is what makes it.
        if plan.engine == EngineName::GpuGrid && plan.encoding != Encoding::Dense {
            takes(EngineName::GpuGrid)?;
            match self.grid.cull_objects(objects, plan.encoding, reply) {
                Err(error @ CullError::TooCrowded { .. }) if self.is_sooner_on_cores(plan) => {
                    return Err(error);
                }
                Err(CullError::TooCrowded { .. } | CullError::TooManyBoxes { .. }) => {}
                done => return Ok((done?, EngineName::GpuGrid)),
            }
        }
        takes(EngineName::GpuBrute)?;
        let report = self.all_pairs.cull_objects(objects, plan.encoding, reply)?;
        Ok((report, EngineName::GpuBrute))
    }

    /// Whether cores cull a scene that crowds the grid sooner, by their tree, than this GPU by all pairs, and may.
    fn is_sooner_on_cores(&self, plan: &Plan) -> bool {
        let tree = plan.candidates[EngineName::CpuTree.ordinal()];
        let on_cores = tree.filter(|_| plan.options.engine == EngineChoice::Auto);
        self.cost.zip(on_cores).is_some_and(|(gpu, tree)| {
            gpu.ns_a_test * plan.stats.n.pair_count() as f64 > tree.predicted_ns
        })
    }

    /// Imports the objects of an owner, and keeps the clocks up for the next frame.
    fn note_frame(&mut self, owner: Owner, objects: Objects<'_>) {
        self.change_imports(|imports, gpu| imports.offer_objects(gpu, owner, objects));
        if let Some(awake) = &self.awake {
            awake.note_frame();
        }
    }

    /// Changes what is imported. What was recorded for imports that have ended goes.
    fn change_imports(&mut self, change: impl FnOnce(&mut Imports, &Arc<Gpu>) -> Vec<Arc<Block>>) {
        let ended = change(&mut self.imports.lock(), self.grid.gpu());
        for block in ended {
            self.all_pairs.drop_frames_of(&block);
            self.grid.drop_frames_of(&block);
        }
    }
}

impl AsRef<Gpu> for Engines {
    fn as_ref(&self) -> &Gpu {
        self.grid.gpu()
    }
}

/// Is shown each device that is opened: tests lose it.
pub type WatchDevice = fn(&Arc<Gpu>);

pub struct GpuService(GpuSlot<Engines>);

/// Fewest boxes of a frame that is left to the GPU meanwhile. Where all pairs and the grid are equally
/// fast on an H200: below, plans take all pairs, whose frames are not left under way.
const UNDER_WAY_BOXES: u32 = 16_384;
/// The same on a software adapter, whose frames take milliseconds from here on.
const UNDER_WAY_SOFTWARE_BOXES: u32 = 32_768;

impl GpuService {
    /// The GPU of a choice, without waiting for the device: another thread opens it and makes its engines, and `watch`
    /// is shown it and each that takes its place. Its clocks are kept up for `hold` after each frame, and submission of a
    /// scene, where it has a queue for that; zero leaves them alone.
    pub fn opening(
        choice: &GpuChoice,
        hold: Duration,
        watch: Option<WatchDevice>,
        if_missing: IfMissing,
    ) -> Self {
        let choice = choice.clone();
        let open = move || {
            let gpu = Gpu::open(&choice, HostImport::IfPossible)?;
            if let Some(watch) = watch {
                watch(&gpu);
            }
            Ok(Engines::new(&gpu, hold)?)
        };
        Self(GpuSlot::opening(Arc::new(open), if_missing))
    }

    pub(super) fn outlook(&self) -> (Outlook, Weak<Gpu>) {
        let (state, engines) = (self.0.state(), self.0.opened());
        let is_software = engines.is_some_and(|engines| engines.grid.gpu().is_software());
        let least = if is_software { UNDER_WAY_SOFTWARE_BOXES } else { UNDER_WAY_BOXES };
        let outlook = Outlook {
            cost: engines.and_then(|engines| engines.cost),
            under_way_boxes: engines.map(|_| least),
            is_software,
            is_opening: state == SlotState::Opening,
            is_missing: state == SlotState::Missing,
        };
        let device = engines.map(|engines| Arc::downgrade(engines.grid.gpu()));
        (outlook, device.unwrap_or_default())
    }

    pub fn device(&mut self) -> Option<Arc<Gpu>> {
        self.0.ready().map(|engines| Arc::clone(engines.grid.gpu()))
    }

    pub(super) fn scene_tools(&mut self) -> Option<Arc<SceneTools>> {
        self.0.ready().map(|engines| Arc::clone(&engines.scenes))
    }

    pub fn cull(
        &mut self,
        objects: Objects<'_>,
        owner: Owner,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(CullReport, EngineName), CullError> {
        if !plan.engine.is_gpu() {
            return Err(CullError::Unavailable { engine: plan.engine, why: "no such GPU engine" });
        }
        let lost = CullError::DeviceLost { engine: plan.engine };
        let engines = self.0.ready().ok_or(lost)?;
        engines.note_frame(owner, objects);
        engines.cull(objects, plan, reply)
    }

    pub(super) fn cull_ruled(
        &mut self,
        boxes: BoxSlice<'_>,
        owner: Owner,
        marks: &Arc<Marks>,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
        ranges: &mut Vec<WorldRange>,
    ) -> Result<CullReport, CullError> {
        let lost = CullError::DeviceLost { engine: EngineName::GpuGrid };
        let engines = self.0.ready().ok_or(lost)?;
        engines.note_frame(owner, boxes.into());
        engines.grid.cull_ruled(boxes, marks, encoding, reply, ranges)
    }

    /// Imports the memory of a reply that the GPU wrote, so that the next mask in it needs no copy.
    pub(super) fn offer_reply(&mut self, lent: LentReply) {
        if let Some(engines) = self.0.opened_mut() {
            engines.change_imports(|imports, gpu| imports.offer_reply(gpu, lent));
        }
    }

    /// Lets go of the memory of replies in a range of addresses. Whether nothing of the GPU knows it any more.
    pub(super) fn release_reply(&mut self, range: &Range<usize>) -> bool {
        self.0.opened_mut().is_none_or(|engines| {
            engines.change_imports(|imports, _| imports.leave(range));
            engines.imports.lock().has_left(range)
        })
    }

    pub fn begin<M: FrameMemory>(&mut self, mut memory: M, owner: Owner, plan: &Plan) -> Begun<M> {
        let lost = CullError::DeviceLost { engine: plan.engine };
        let Some(engines) = self.0.ready() else {
            return Err((lost, Some(memory)));
        };
        memory.with(|objects, _| engines.note_frame(owner, objects));
        engines.grid.begin(memory, plan.encoding)
    }

    pub fn begin_bundle<M: FrameMemory>(
        &mut self,
        frames: Vec<(M, Owner, Encoding)>,
    ) -> Vec<Begun<M>> {
        let Some(engines) = self.0.ready() else {
            let lost = |(memory, _, _)| {
                Err((CullError::DeviceLost { engine: EngineName::GpuGrid }, Some(memory)))
            };
            return frames.into_iter().map(lost).collect();
        };
        let noted = frames.into_iter().map(|(mut memory, owner, encoding)| {
            memory.with(|objects, _| engines.note_frame(owner, objects));
            (memory, encoding)
        });
        let noted = noted.collect();
        engines.grid.begin_bundle(noted)
    }

    /// Waits for a frame that was begun with `plan`. Its memory is `None` where the device keeps it.
    pub fn end<M: FrameMemory>(
        &mut self,
        mut frame: GridUnderWay<M>,
        plan: &Plan,
    ) -> (Result<(CullReport, EngineName), CullError>, Option<M>) {
        let Some(engines) = self.0.opened_mut() else {
            return (Err(CullError::DeviceLost { engine: plan.engine }), frame.give_up());
        };
        let ended = engines.grid.wait_for(&mut frame);
        let mut lent = frame.lent;
        let mut memory = frame.give_up();
        let answered = match (ended, &mut memory) {
            (Err(CullError::TooCrowded { .. }), Some(memory))
                if !engines.is_sooner_on_cores(plan) =>
            {
                with_lent(memory, &mut lent, |objects, reply| {
                    engines.all_pairs.cull_objects(objects, plan.encoding, reply)
                })
                .map(|report| (report, EngineName::GpuBrute))
            }
            (ended, _) => ended.map(|report| (report, EngineName::GpuGrid)),
        };
        if answered.is_ok() {
            engines.change_imports(|imports, gpu| imports.offer_reply(gpu, lent));
        }
        (answered, memory)
    }

    /// Gives up what is kept of disconnected clients. Where there is no device, takes in one that was opened.
    pub(super) fn tidy(&mut self, segments: &[u64]) {
        match self.0.opened_mut() {
            Some(engines) => engines.change_imports(|imports, _| imports.tidy(segments)),
            None => drop(self.0.ready()),
        }
    }
}

/// Boxes of the scene that is timed: all-pairs tests outweigh the rest of its frame.
const TIMED_BOXES: usize = 8192;
/// Boxes of the scene that the grid is timed on: enough to fill a large GPU.
const TIMED_GRID_BOXES: usize = 65_536;
/// The same on a software adapter, where more would hold the start up for seconds.
const TIMED_SOFTWARE_BOXES: usize = 2048;
/// Boxes of a scene that takes no time but what every scene takes.
const TIMED_LEAST_BOXES: usize = 64;
/// Frames of which the fastest counts; the first one compiles and allocates.
const TIMED_FRAMES: usize = 4;
/// A byte of the mask that crosses the link: 24 GB/s, what a card on `PCIe` 4.0 gives (an H200: 34
/// to 52).
const LINK_NS_A_BYTE: f64 = 0.04;

/// More for a byte that a client reads of memory that the device wrote, beyond what iterating over takes
/// where a cache holds the mask: between none (0.8 MB) and 0.05 (55 MB) on the host of an H200, with
/// the lines ahead fetched.
const FAR_NS_A_BYTE: f64 = 0.02;

fn measure(engines: &mut Engines, profiled: &EngineOptions) -> Option<GpuCost> {
    let apart = |i: usize| {
        let [x, y, z] = [i % 64, i / 64 % 64, i / 4096].map(|x| x as f32 * 2.0);
        Aabb::from([x, y, z, x + 1.0, y + 1.0, z + 1.0])
    };
    let boxes: Vec<Aabb> = (0..TIMED_GRID_BOXES).map(apart).collect();
    let mut reply = HeapReply::new();
    let mut fastest_ns = |engine: &mut dyn Engine, n: usize| {
        let frame = |_| {
            let start = Instant::now();
            engine.cull(&CullInput::boxes(&boxes[..n]), &mut reply).ok()?;
            Some(nanoseconds_since(start) as f64)
        };
        (0..TIMED_FRAMES).map(frame).try_fold(f64::INFINITY, |least, ns| Some(least.min(ns?)))
    };
    let fixed_ns = fastest_ns(&mut engines.all_pairs, TIMED_LEAST_BOXES)?;
    let large_ns = fastest_ns(&mut engines.all_pairs, TIMED_BOXES)?;
    let grid_least_ns = fastest_ns(&mut engines.grid, TIMED_LEAST_BOXES)?;
    // By the GPU's clock: these boxes are staged, those of clients are not.
    let grid_software = engines.grid.gpu().is_software();
    let mut grid = Grid::new(engines.grid.gpu(), profiled).ok()?;
    let mut stages_ns = |n: usize| -> Option<(f64, f64)> {
        fastest_ns(&mut grid, n)?;
        let times = grid.step_times();
        let up: f64 = times.iter().filter(|s| s.label == "grid_cells").map(|s| s.ns).sum();
        Some((up, times.iter().map(|step| step.ns).sum::<f64>() - up))
    };
    let (least_up_ns, least_rest_ns) = stages_ns(TIMED_LEAST_BOXES)?;
    let many = if grid_software { TIMED_SOFTWARE_BOXES } else { TIMED_GRID_BOXES };
    let (up_ns, rest_ns) = stages_ns(many)?;
    let a_box = |ns: f64, least_ns: f64| (ns - least_ns).max(0.0) / many as f64;
    let ns_a_box = a_box(up_ns, least_up_ns);
    let tests = (TIMED_BOXES * (TIMED_BOXES - 1) / 2) as f64;
    let tests_ns = large_ns - fixed_ns - ns_a_box * TIMED_BOXES as f64;
    Some(GpuCost {
        fixed_ns,
        ns_a_box,
        ns_a_test: tests_ns.max(0.0) / tests,
        grid_fixed_ns: (grid_least_ns - fixed_ns).max(0.0),
        grid_ns_a_box: Some(a_box(rest_ns, least_rest_ns)),
        ns_a_reply_byte: LINK_NS_A_BYTE,
        ns_a_read_byte: FAR_NS_A_BYTE,
    })
}
