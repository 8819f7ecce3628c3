//! The GPU as the daemon uses it: opened once, its imports kept, replaced when lost.

use std::sync::Arc;
use std::time::Instant;

use pairmask::engine::{
    CullError, CullJob, CullReport, Engine, EngineName, HeapReply, ReplyBuffer, ReserveError,
    nanoseconds_since,
};
use pairmask::plan::{GpuCost, Plan};
use pairmask::{Aabb, Encoding};

use super::gpu::device::HostImport;
use super::gpu::import::ImportId;
use super::gpu::pipeline::user_cache_folder;
use super::gpu::{AllPairs, AllPairsOptions, Gpu, GpuChoice, GpuSlot, OpenError};

/// Whose memory an address is: a client's port, or our own server port. Memory of one owner stays
/// mapped at its address as long as the owner lives; that of another may come to lie there later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// A client's port, by the transport's unique number.
    Client(u128),
    /// This process.
    Daemon,
    /// Memory that this process may give back to the system at any time: it is not imported.
    Scratch,
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

/// The GPU's engine, on whatever device there is now.
pub struct GpuService {
    slot: GpuSlot,
    engine: Option<AllPairs>,
    cost: Option<GpuCost>,
    offered: Vec<Offered>,
}

impl GpuService {
    /// Opens the GPU of a choice.
    ///
    /// # Errors
    /// [`OpenError`]; [`OpenError::NoAdapter`] where nothing fits the choice.
    pub fn open(choice: &GpuChoice) -> Result<Self, OpenError> {
        let choice = choice.clone();
        let open = Arc::new(move || Gpu::open(&choice, HostImport::IfPossible));
        let gpu = open()?;
        log::info!("GPU: {}", gpu.info().name);
        let mut service =
            Self { slot: GpuSlot::new(gpu, open), engine: None, cost: None, offered: Vec::new() };
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
        self.engine.as_ref().and(self.cost)
    }

    /// Makes the engine that belongs to the device of now. `false` where there is none.
    fn refresh(&mut self) -> bool {
        let Some(gpu) = self.slot.ready() else {
            self.engine = None;
            self.offered.clear();
            return false;
        };
        if self.engine.as_ref().is_some_and(|engine| Arc::ptr_eq(engine.gpu(), &gpu)) {
            return true;
        }
        self.engine = None;
        self.offered.clear();
        let options =
            AllPairsOptions { cache_folder: user_cache_folder(), ..AllPairsOptions::default() };
        match AllPairs::new(&gpu, options) {
            Ok(mut engine) => {
                self.cost = measure(&mut engine);
                self.engine = Some(engine);
            }
            Err(error) => {
                log::error!("the GPU engine cannot be made: {error}");
                gpu.health().mark_lost();
            }
        }
        self.engine.is_some()
    }

    /// Finds the pairs of boxes that belong to `owner`.
    ///
    /// # Errors
    /// [`CullError::DeviceLost`] and [`CullError::DeviceMemory`] leave the frame to the CPU.
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        owner: Owner,
        plan: &Plan,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        if plan.engine != EngineName::GpuBrute {
            return Err(CullError::Unavailable { engine: plan.engine, why: "no such GPU engine" });
        }
        let job = &CullJob { encoding: plan.encoding, threads: plan.threads };
        if !self.refresh() {
            return Err(CullError::DeviceLost { engine: EngineName::GpuBrute });
        }
        self.offer(owner, boxes.as_ptr() as usize, size_of_val(boxes));
        let mut noted = NotedReply { inner: reply, at: (0, 0) };
        let engine =
            self.engine.as_mut().ok_or(CullError::DeviceLost { engine: EngineName::GpuBrute })?;
        let report = engine.cull(boxes, job, &mut noted)?;
        // Imported when this frame is done, so that the next mask in the same memory needs no copy.
        let (start, bytes) = noted.at;
        self.offer(Owner::Daemon, start, bytes);
        Ok(report)
    }

    /// Imports memory unless it is known. An import costs 0.2 to 10 ms, once for each chunk.
    fn offer(&mut self, owner: Owner, start: usize, bytes: usize) {
        let Some(engine) = self.engine.as_mut() else { return };
        let end = start + bytes;
        let known = |o: &Offered| o.owner == owner && o.start <= start && end <= o.start + o.bytes;
        if bytes == 0 || self.offered.iter().any(known) {
            return;
        }
        // Whatever else was known of these addresses is gone, or too short.
        self.offered.retain(|o| {
            let apart = end <= o.start || o.start + o.bytes <= start;
            if !apart && let Some(import) = o.import {
                engine.forget(import);
            }
            apart
        });
        if owner == Owner::Scratch {
            return;
        }
        if self.offered.len() >= OFFERED_LIMIT
            && let Some(import) = self.offered.remove(0).import
        {
            engine.forget(import);
        }
        let import = match engine.import(start, bytes) {
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
        let Some(engine) = self.engine.as_mut() else { return };
        self.offered.retain(|offered| {
            let gone = offered.import.is_some_and(|import| engine.is_orphaned(import));
            if gone && let Some(import) = offered.import {
                engine.forget(import);
            }
            !gone
        });
    }
}

/// Boxes of the scene that is timed: all-pairs tests outweigh the rest of its frame.
const TIMED_BOXES: usize = 8192;
/// Frames of which the fastest counts; the first one compiles and allocates.
const TIMED_FRAMES: usize = 4;
/// A box crosses the link at 24 GB/s, what a card on `PCIe` 4.0 gives (an H200: 34 to 48).
const LINK_NS_A_BOX: f64 = 1.0;
/// A byte of the mask crosses it the other way.
const LINK_NS_A_BYTE: f64 = 0.04;

/// Times small frames on a device that was just opened.
fn measure(engine: &mut AllPairs) -> Option<GpuCost> {
    let apart = |i: usize| Aabb::from([i as f32 * 2.0, 0.0, 0.0, i as f32 * 2.0 + 1.0, 1.0, 1.0]);
    let boxes: Vec<Aabb> = (0..TIMED_BOXES).map(apart).collect();
    let mut reply = HeapReply::new();
    let mut fastest_ns = |n: usize| {
        let job = CullJob { encoding: Encoding::Sparse, threads: 1 };
        let frame = |_| {
            let start = Instant::now();
            engine.cull(&boxes[..n], &job, &mut reply).ok()?;
            Some(nanoseconds_since(start) as f64)
        };
        (0..TIMED_FRAMES).map(frame).try_fold(f64::INFINITY, |least, ns| Some(least.min(ns?)))
    };
    let (fixed_ns, large_ns) = (fastest_ns(64)?, fastest_ns(TIMED_BOXES)?);
    let tests = (TIMED_BOXES * (TIMED_BOXES - 1) / 2) as f64;
    let tests_ns = large_ns - fixed_ns - LINK_NS_A_BOX * TIMED_BOXES as f64;
    Some(GpuCost {
        fixed_ns,
        ns_a_box: LINK_NS_A_BOX,
        ns_a_test: tests_ns.max(0.0) / tests,
        grid_ns_a_box: None,
        ns_a_reply_byte: LINK_NS_A_BYTE,
    })
}

/// Takes note of the memory that was reserved.
struct NotedReply<'a> {
    inner: &'a mut dyn ReplyBuffer,
    at: (usize, usize),
}

impl ReplyBuffer for NotedReply<'_> {
    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let memory = self.inner.reserve(words)?;
        self.at = (memory.as_ptr() as usize, size_of_val(memory));
        Ok(memory)
    }
}
