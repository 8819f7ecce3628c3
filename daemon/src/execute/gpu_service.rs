//! The GPU as the daemon uses it: opened once, its imports kept, replaced when lost.

use std::sync::Arc;

use pairmask::Aabb;
use pairmask::engine::{
    CullError, CullJob, CullReport, Engine, EngineName, ReplyBuffer, ReserveError,
};

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
        let mut service = Self { slot: GpuSlot::new(gpu, open), engine: None, offered: Vec::new() };
        // Compiling takes up to a second: now, not in the first frame.
        service.refresh();
        Ok(service)
    }

    /// The device, if there is one now.
    pub fn device(&mut self) -> Option<Arc<Gpu>> {
        self.slot.ready()
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
            Ok(engine) => self.engine = Some(engine),
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
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
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
