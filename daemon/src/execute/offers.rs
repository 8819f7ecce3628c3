//! Memory that frames came with, imported for the frames to come.
//!
//! An import costs 0.2 to 10 ms, once for each piece of memory. The first frame in it is staged or
//! waits for the import; every later one needs no copy.
#![allow(unsafe_code)]

use std::sync::Arc;

use pairmask_core::objects::Objects;

use super::frame_memory::LentReply;
use super::gpu::{Block, Gpu, ImportError, ImportId, SharedImports};

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
    /// `None` where the driver or the system refused: the staged path serves, and the import is
    /// not tried again.
    import: Option<ImportId>,
}

/// Pieces of memory that are remembered: three frames of each of some dozens of clients, and as
/// many replies. The oldest is forgotten beyond, and imported again when it comes back.
const OFFERED_LIMIT: usize = 128;

/// What was offered to a device.
pub(super) struct Offers {
    gpu: Arc<Gpu>,
    imports: SharedImports,
    offered: Vec<Offered>,
}

/// Blocks of imports that have ended. Frames that were recorded for them are to be dropped.
type Forgotten = Vec<Arc<Block>>;

impl Offers {
    /// Nothing yet. Engines that share `imports` find what is offered.
    pub(super) fn new(gpu: &Arc<Gpu>, imports: SharedImports) -> Self {
        Self { gpu: Arc::clone(gpu), imports, offered: Vec::new() }
    }

    /// Imports the objects of an owner unless they are known.
    #[must_use]
    pub(super) fn objects(&mut self, owner: Owner, objects: Objects<'_>) -> Forgotten {
        let memory = objects.as_bytes();
        let (start, bytes) = (memory.as_ptr() as usize, memory.len());
        self.offer(owner, start, bytes, |offers| {
            offers.imports.lock().import_boxes(&offers.gpu, start, bytes)
        })
    }

    /// Imports memory that a reply lent unless it is known, so that the next mask in it needs no copy.
    #[must_use]
    pub(super) fn reply(&mut self, lent: LentReply) -> Forgotten {
        let (start, bytes) = (lent.start(), lent.bytes());
        self.offer(Owner::Daemon, start, bytes, |offers| {
            // SAFETY: the reply of a `FrameMemory` lent this range, and only one makes a
            // `LentReply`: shared memory that it lends stays mapped to the same pages as long as
            // the engines live.
            unsafe { offers.imports.lock().import_replies(&offers.gpu, start, bytes) }
        })
    }

    fn offer(
        &mut self,
        owner: Owner,
        start: usize,
        bytes: usize,
        import: impl FnOnce(&Self) -> Result<ImportId, ImportError>,
    ) -> Forgotten {
        let mut forgotten = Forgotten::new();
        let end = start + bytes;
        let known = |o: &Offered| o.owner == owner && o.start <= start && end <= o.start + o.bytes;
        if bytes == 0 || self.offered.iter().any(known) {
            return forgotten;
        }
        let Self { imports, offered, .. } = self;
        let mut forget = |offered: &Offered| {
            forgotten.extend(offered.import.and_then(|import| imports.lock().take(import)));
        };
        // Whatever else was known of these addresses is gone, or too short.
        offered.retain(|o| {
            let apart = end <= o.start || o.start + o.bytes <= start;
            if !apart {
                forget(o);
            }
            apart
        });
        if offered.len() >= OFFERED_LIMIT {
            forget(&offered.remove(0));
        }
        let import = import(self)
            .inspect_err(|error| log::debug!("staging instead of importing: {error}"))
            .ok();
        self.offered.push(Offered { owner, start, bytes, import });
        forgotten
    }

    /// Gives up memory whose owner is gone; to be called now and then.
    #[must_use]
    pub(super) fn tidy(&mut self) -> Forgotten {
        let mut forgotten = Forgotten::new();
        let Self { imports, offered, .. } = self;
        offered.retain(|offered| {
            let Some(import) = offered.import else { return true };
            let gone = imports.lock().is_orphaned(import);
            if gone {
                forgotten.extend(imports.lock().take(import));
            }
            !gone
        });
        forgotten
    }
}
