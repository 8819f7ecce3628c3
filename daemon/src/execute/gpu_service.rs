//! The GPU as the daemon uses it: opened once, its imports kept, replaced when lost.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask::dispatch::nanoseconds_since;
use pairmask::engine::{
    CullError, CullInput, CullReport, Engine, EngineName, HeapReply, ReplyBuffer, ReserveError,
};
use pairmask::plan::{GpuCost, Plan, user_cache_folder};
use pairmask::precision::NarrowBoxes;
use pairmask::{Aabb, Encoding};

use super::gpu::awake::Awake;
use super::gpu::device::{HostImport, Lane};
use super::gpu::import::ImportId;
use super::gpu::{
    AllPairs, AllPairsOptions, Gpu, GpuChoice, GpuError, GpuSlot, Grid, GridOptions, OpenError,
    SharedImports,
};

/// Whose memory an address is: a client's port, or our own server port. Memory of one owner stays
/// mapped at its address as long as the owner lives; that of another may come to lie there later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// A client's port, by the transport's unique number.
    Client(u128),
    /// This process.
    Daemon,
}

/// Memory that was offered to the GPU.
struct Offered {
    owner: Owner,
    start: usize,
    bytes: usize,
    /// `None` where the driver or the system refused: the staged path serves, and nobody asks
    /// again.
    import: Option<ImportId>,
}

/// Pieces of memory that are remembered: three frames of each of some dozens of clients, and as
/// many replies. The oldest is forgotten beyond, and imported again when it comes back.
const OFFERED_LIMIT: usize = 128;

/// The engines of a device.
struct Engines {
    all_pairs: AllPairs,
    grid: Grid,
    /// Of both.
    imports: SharedImports,
    cost: Option<GpuCost>,
    awake: Option<Awake>,
}

impl Engines {
    fn new(gpu: &Arc<Gpu>, hold: Duration) -> Result<Self, GpuError> {
        let imports = SharedImports::default();
        let cache_folder = user_cache_folder();
        let all_pairs = AllPairsOptions {
            cache_folder: cache_folder.clone(),
            imports: imports.clone(),
            ..AllPairsOptions::default()
        };
        let grid = GridOptions { cache_folder, imports: imports.clone(), ..GridOptions::default() };
        let mut engines = Self {
            all_pairs: AllPairs::new(gpu, all_pairs)?,
            grid: Grid::new(gpu, &grid)?,
            imports,
            cost: None,
            awake: Awake::start(gpu, hold)?,
        };
        engines.cost = measure(&mut engines, &GridOptions { profiled: true, ..grid });
        Ok(engines)
    }

    /// Runs the engine of a plan, or the one that can do what it cannot.
    fn cull(
        &mut self,
        boxes: NarrowBoxes<'_>,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(CullReport, EngineName), CullError> {
        // A dense mask has a bit for all pairs, so all pairs is what makes it.
        if plan.engine == EngineName::GpuGrid && plan.encoding == Encoding::Sparse {
            match self.grid.cull(&plan.input(boxes), reply) {
                Err(CullError::TooCrowded { .. } | CullError::TooManyBoxes { .. }) => {}
                done => return Ok((done?, EngineName::GpuGrid)),
            }
        }
        Ok((self.all_pairs.cull(&plan.input(boxes), reply)?, EngineName::GpuBrute))
    }

    /// Keeps the clocks up for the next frame.
    fn note_frame(&self) {
        if let Some(awake) = &self.awake {
            awake.note_frame();
        }
    }

    fn forget(&mut self, import: ImportId) {
        let forgotten = self.imports.lock().forget(import);
        if let Some(block) = forgotten {
            self.all_pairs.drop_frames_of(&block);
            self.grid.drop_frames_of(&block);
        }
    }
}

/// The GPU's engines, on whatever device there is now.
pub struct GpuService {
    slot: GpuSlot,
    engines: Option<Engines>,
    /// How long the clocks are kept up after a frame.
    hold: Duration,
    offered: Vec<Offered>,
}

/// How long a look at a software adapter's frame waits for the next.
const SOFTWARE_REST: Duration = Duration::from_micros(200);

/// A frame that the GPU works on while the daemon does something else.
#[derive(Debug)]
pub struct GpuFrame {
    lane: Lane,
    /// Where the mask goes.
    reply_at: (usize, usize),
}

/// Fewest boxes of a frame that is left to the GPU meanwhile. Where all pairs and the grid are equally
/// fast on an H200: below, plans take all pairs, whose frames are not left under way.
const UNDER_WAY_BOXES: u32 = 16_384;
/// The same on a software adapter, whose frames take milliseconds from here on.
const UNDER_WAY_SOFTWARE_BOXES: u32 = 32_768;

impl GpuService {
    /// Opens the GPU of a choice. Its clocks are kept up for `hold` after each frame, where it has a
    /// queue for that; zero leaves them alone.
    ///
    /// # Errors
    /// [`OpenError`]; [`OpenError::NoAdapter`] where nothing fits the choice.
    pub fn open(choice: &GpuChoice, hold: Duration) -> Result<Self, OpenError> {
        let choice = choice.clone();
        let open = Arc::new(move || Gpu::open(&choice, HostImport::IfPossible));
        let gpu = open()?;
        log::info!("GPU: {}", gpu.info().name);
        let mut service =
            Self { slot: GpuSlot::new(gpu, open), engines: None, hold, offered: Vec::new() };
        // Compiling takes up to a second: now, not in the first frame.
        service.refresh();
        Ok(service)
    }

    /// The device, if there is one now.
    pub fn device(&mut self) -> Option<Arc<Gpu>> {
        self.slot.ready()
    }

    /// What frames cost on the device of now.
    pub fn cost(&self) -> Option<GpuCost> {
        self.engines.as_ref()?.cost
    }

    /// Makes the engines that belong to the device of now. `false` where there is none.
    fn refresh(&mut self) -> bool {
        let Some(gpu) = self.slot.ready() else {
            self.engines = None;
            self.offered.clear();
            return false;
        };
        if self.engines.as_ref().is_some_and(|e| Arc::ptr_eq(e.all_pairs.gpu(), &gpu)) {
            return true;
        }
        self.engines = None;
        self.offered.clear();
        match Engines::new(&gpu, self.hold) {
            Ok(engines) => self.engines = Some(engines),
            Err(error) => {
                log::error!("the GPU engines cannot be made: {error}");
                gpu.health().mark_lost();
            }
        }
        self.engines.is_some()
    }

    /// Finds the pairs of boxes that belong to `owner`, and says which engine did.
    ///
    /// # Errors
    /// [`CullError::DeviceLost`] and [`CullError::DeviceMemory`] leave the frame to the CPU.
    pub fn cull(
        &mut self,
        boxes: NarrowBoxes<'_>,
        owner: Owner,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(CullReport, EngineName), CullError> {
        if !plan.engine.is_gpu() {
            return Err(CullError::Unavailable { engine: plan.engine, why: "no such GPU engine" });
        }
        let lost = CullError::DeviceLost { engine: plan.engine };
        if !self.refresh() {
            return Err(lost);
        }
        let memory = boxes.as_bytes();
        self.offer(owner, memory.as_ptr() as usize, memory.len());
        let mut noted = NotedReply { inner: reply, at: (0, 0) };
        let engines = self.engines.as_mut().ok_or(lost)?;
        engines.note_frame();
        let done = engines.cull(boxes, plan, &mut noted)?;
        // Imported when this frame is done, so that the next mask in the same memory needs no copy.
        let (start, bytes) = noted.at;
        self.offer(Owner::Daemon, start, bytes);
        Ok(done)
    }

    /// Whether a frame of this plan may be left to the GPU ([`Self::begin`]).
    pub fn can_begin(&self, plan: &Plan) -> bool {
        let Some(engines) = &self.engines else { return false };
        let software = engines.grid.gpu().info().is_software();
        let least = if software { UNDER_WAY_SOFTWARE_BOXES } else { UNDER_WAY_BOXES };
        plan.engine == EngineName::GpuGrid
            && plan.encoding == Encoding::Sparse
            && plan.stats.n.get() >= least
    }

    /// Starts a frame of boxes that belong to `owner`. They and the reply stay where they are until
    /// [`Self::end`], or until the service is dropped.
    ///
    /// # Errors
    /// As [`Self::cull`]; nothing is under way then.
    pub fn begin(
        &mut self,
        boxes: NarrowBoxes<'_>,
        owner: Owner,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<GpuFrame, CullError> {
        let lost = CullError::DeviceLost { engine: plan.engine };
        if !self.refresh() {
            return Err(lost);
        }
        let memory = boxes.as_bytes();
        self.offer(owner, memory.as_ptr() as usize, memory.len());
        let mut noted = NotedReply { inner: reply, at: (0, 0) };
        let engines = self.engines.as_mut().ok_or(lost)?;
        engines.note_frame();
        let lane = engines.grid.begin(boxes, plan.encoding, &mut noted)?;
        Ok(GpuFrame { lane, reply_at: noted.at })
    }

    /// Whether a frame has ended, so that [`Self::end`] does not wait.
    pub fn has_ended(&self, frame: &GpuFrame) -> bool {
        self.engines.as_ref().is_none_or(|engines| engines.grid.has_ended(frame.lane))
    }

    /// Waits for a frame. `boxes`, `plan` and `reply` are those that it began with.
    ///
    /// # Errors
    /// As [`Self::cull`].
    pub fn end(
        &mut self,
        frame: &GpuFrame,
        boxes: NarrowBoxes<'_>,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(CullReport, EngineName), CullError> {
        let engines = self.engines.as_mut().ok_or(CullError::DeviceLost { engine: plan.engine })?;
        let mut noted = NotedReply { inner: reply, at: frame.reply_at };
        let done = match engines.grid.end(frame.lane, boxes, &mut noted) {
            Err(CullError::TooCrowded { .. }) => {
                (engines.all_pairs.cull(&plan.input(boxes), &mut noted)?, EngineName::GpuBrute)
            }
            done => (done?, EngineName::GpuGrid),
        };
        let (start, bytes) = noted.at;
        self.offer(Owner::Daemon, start, bytes);
        Ok(done)
    }

    /// Gives the core away for a moment where the GPU needs it: a software adapter's frames run on
    /// the same cores as this.
    pub fn rest(&mut self) {
        if self.device().is_some_and(|gpu| gpu.info().is_software()) {
            std::thread::sleep(SOFTWARE_REST);
        } else {
            std::hint::spin_loop();
        }
    }

    /// Imports memory unless it is known. An import costs 0.2 to 10 ms, once for each chunk.
    fn offer(&mut self, owner: Owner, start: usize, bytes: usize) {
        let Some(engines) = self.engines.as_mut() else { return };
        let end = start + bytes;
        let known = |o: &Offered| o.owner == owner && o.start <= start && end <= o.start + o.bytes;
        if bytes == 0 || self.offered.iter().any(known) {
            return;
        }
        // Whatever else was known of these addresses is gone, or too short.
        self.offered.retain(|o| {
            let apart = end <= o.start || o.start + o.bytes <= start;
            if !apart && let Some(import) = o.import {
                engines.forget(import);
            }
            apart
        });
        if self.offered.len() >= OFFERED_LIMIT
            && let Some(import) = self.offered.remove(0).import
        {
            engines.forget(import);
        }
        let import = match engines.all_pairs.import(start, bytes) {
            Ok(import) => Some(import),
            Err(error) => {
                log::debug!("staging instead of importing: {error}");
                None
            }
        };
        self.offered.push(Offered { owner, start, bytes, import });
    }

    /// Gives up memory whose owner is gone; to be called now and then.
    pub fn tidy(&mut self) {
        let Some(engines) = self.engines.as_mut() else { return };
        self.offered.retain(|offered| {
            let Some(import) = offered.import else { return true };
            let gone = engines.imports.lock().is_orphaned(import);
            if gone {
                engines.forget(import);
            }
            !gone
        });
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

/// Times small frames on a device that was just opened.
fn measure(engines: &mut Engines, grid: &GridOptions) -> Option<GpuCost> {
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
    let grid_software = engines.grid.gpu().info().is_software();
    let mut grid = Grid::new(engines.grid.gpu(), grid).ok()?;
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
    })
}

/// Takes note of the memory that was reserved.
struct NotedReply<'a> {
    inner: &'a mut dyn ReplyBuffer,
    at: (usize, usize),
}

impl ReplyBuffer for NotedReply<'_> {
    fn limit_words(&self) -> u64 {
        self.inner.limit_words()
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let memory = self.inner.reserve(words)?;
        self.at = (memory.as_ptr() as usize, size_of_val(memory));
        Ok(memory)
    }
}
