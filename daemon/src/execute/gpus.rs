//! The GPUs of a daemon, and which of them takes a frame, a session or a scene.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

use pairmask_core::EngineName;
use pairmask_core::engine::CullError;
use pairmask_core::plan::GpuCost;
use pairmask_transport::GpuCounts;

use super::GpuService;
use super::gpu::{Gpu, SceneTools, compute_alike};
use super::shared_gpu::SharedGpu;
use super::turns::Turn;

/// Fewest boxes of a scene that all GPUs keep: each edit is brought to all of them, and a search of fewer boxes ends
/// too soon to make up for that.
const SHARED_SCENE_BOXES: usize = 1_000_000;

/// The GPUs that the executors of all sessions share. There may be none.
#[derive(Clone, Default)]
pub struct Gpus {
    all: Arc<[Arc<SharedGpu>]>,
    /// Whose turn it is to be the home of a session, or of a scene.
    next_home: Arc<AtomicUsize>,
}

impl Gpus {
    pub(super) fn new(services: impl IntoIterator<Item = GpuService>) -> Self {
        let shared = services.into_iter().zip(0..).map(|(s, at)| Arc::new(SharedGpu::new(s, at)));
        Self { all: shared.collect(), next_home: Arc::default() }
    }

    /// Whether they compute the same bits, so that they may share scenes: each looks for the pairs of the cells that
    /// are its, and computes them all.
    fn are_alike(&self) -> bool {
        let devices: Vec<Arc<Gpu>> = self.all.iter().filter_map(|gpu| gpu.device()).collect();
        devices.windows(2).all(|two| compute_alike(two[0].info(), two[1].info()))
    }

    pub fn counts(&self) -> GpuCounts {
        let count =
            |is: fn(&SharedGpu) -> bool| self.all.iter().filter(|gpu| is(gpu)).count() as u32;
        GpuCounts {
            opening: count(|gpu| gpu.outlook().is_opening),
            open: count(|gpu| gpu.device().is_some()),
        }
    }

    /// Of those that serve.
    pub fn names(&self) -> Vec<String> {
        let devices = self.all.iter().filter_map(|gpu| gpu.device());
        devices.map(|gpu| gpu.info().name.clone()).collect()
    }

    /// Those that are lost too.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<SharedGpu>> {
        self.all.iter()
    }

    /// The device of the one at this place, if it is there.
    pub fn device(&self, slot: usize) -> Option<Arc<Gpu>> {
        self.all.get(slot)?.with(GpuService::device)
    }

    /// The GPUs of a new scene. Its home is each in turn, of those whose device is there.
    pub fn for_scene(&self) -> SceneGpus {
        let home = self.next_home();
        let home = self.from(home).find(|gpu| gpu.is_there()).or(self.all.get(home)).cloned();
        SceneGpus { home, all: self.clone(), its: Vec::new() }
    }

    /// The GPU of a new session's frames, each in turn: what it imports is best left alone.
    pub(super) fn next_home(&self) -> usize {
        // Relaxed: a number, which orders nothing by itself.
        self.next_home.fetch_add(1, Ordering::Relaxed) % self.all.len().max(1)
    }

    /// The GPU for a frame of a session with this home: that where frames wait least, the home where
    /// others are no better. One without a device only where none has one.
    pub(super) fn for_frame(&self, home: usize) -> Option<&Arc<SharedGpu>> {
        self.from(home).min_by_key(|gpu| (!gpu.is_there(), gpu.queued_steps()))
    }

    /// Another GPU for a frame that this one has lost.
    pub(super) fn beside(&self, lost: &SharedGpu) -> Option<&Arc<SharedGpu>> {
        let others = self.all.iter().filter(|gpu| gpu.number != lost.number && gpu.is_there());
        others.min_by_key(|gpu| gpu.queued_steps())
    }

    fn from(&self, first: usize) -> impl Iterator<Item = &Arc<SharedGpu>> {
        self.all[first.min(self.all.len())..].iter().chain(&self.all[..first.min(self.all.len())])
    }
}

/// The GPUs that may keep a scene: its home, and beside it all others where the scene is large.
#[derive(Clone)]
pub struct SceneGpus {
    home: Option<Arc<SharedGpu>>,
    all: Gpus,
    /// The places of those that have taken the scene, and the devices that they had then.
    its: Vec<(usize, Weak<Gpu>)>,
}

impl SceneGpus {
    /// None: the scene stays with the cores.
    pub fn none() -> Self {
        Self { home: None, all: Gpus::default(), its: Vec::new() }
    }

    /// What a frame costs on the home that comes now.
    pub(super) fn cost(&self) -> Option<GpuCost> {
        self.home.as_ref()?.cost()
    }

    /// Why there is no home for an engine, where its device was never there.
    pub(super) fn check_opened(&self, engine: EngineName) -> Result<(), CullError> {
        self.home.as_ref().map_or(Ok(()), |home| home.check_opened(engine))
    }

    /// What scenes on the home of now share. The scene is its from now on.
    pub(super) fn home(&mut self) -> Option<Arc<SceneTools>> {
        let home = self.home.clone()?;
        let tools = home.with(GpuService::scene_tools)?;
        self.note(&home, &tools);
        Some(tools)
    }

    /// The others, for a scene of so many boxes: none where one GPU searches it as soon. Those alone that are as the
    /// home is: a search is shared out by the cells that each GPU computes, and they must be the same ones. The scene
    /// is theirs too from now on.
    pub(super) fn others(&mut self, boxes: usize) -> Vec<Arc<SceneTools>> {
        if boxes < SHARED_SCENE_BOXES {
            return Vec::new();
        }
        let Some(home) = self.home() else { return Vec::new() };
        let may_share = |tools: &Arc<SceneTools>| {
            let (one, other) = (home.gpu(), tools.gpu());
            !Arc::ptr_eq(one, other) && compute_alike(one.info(), other.info())
        };
        let all = Arc::clone(&self.all.all);
        let mut others = Vec::new();
        for gpu in all.iter().filter(|gpu| gpu.is_there()) {
            if let Some(tools) = gpu.with(GpuService::scene_tools).filter(may_share) {
                self.note(gpu, &tools);
                others.push(tools);
            }
        }
        others
    }

    pub(super) fn most_for(&self, boxes: usize) -> usize {
        if boxes < SHARED_SCENE_BOXES || !self.all.are_alike() {
            return 1;
        }
        self.all.all.iter().filter(|gpu| gpu.is_there()).count().max(1)
    }

    fn note(&mut self, gpu: &SharedGpu, tools: &SceneTools) {
        let device = Arc::downgrade(tools.gpu());
        // One device has one place.
        if !self.its.iter().any(|(_, known)| Weak::ptr_eq(known, &device)) {
            self.its.push((gpu.number, device));
        }
    }

    /// The GPUs whose devices `has` says have the scene, as soon as no other thread uses them: one that has lost it
    /// may be busy with what came of that. A thread that takes several takes them in this order.
    pub(super) fn turns(&self, has: impl Fn(&Gpu) -> bool) -> Vec<Turn<'_>> {
        let has = |device: &Weak<Gpu>| device.upgrade().is_some_and(|device| has(&device));
        let has_it = |gpu: &&Arc<SharedGpu>| {
            self.its.iter().any(|(slot, device)| *slot == gpu.number && has(device))
        };
        self.all.all.iter().filter(has_it).map(|gpu| gpu.turn()).collect()
    }
}
