//! Memory that frames came with, imported for the frames to come.
//!
//! An import costs 0.2 to 10 ms, once for each piece of memory. The first frame in it is staged or
//! waits for the import; every later one needs no copy.
#![allow(unsafe_code)]

use std::ops::Range;
use std::sync::{Arc, Weak};

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

struct Offered {
    owner: Owner,
    start: usize,
    bytes: usize,
    /// `None` where the driver or the system refused: the staged path serves, and the import is
    /// not tried again.
    import: Option<ImportId>,
}

impl Offered {
    fn range(&self) -> Range<usize> {
        self.start..self.start + self.bytes
    }

    /// Ends its import. Where it is of a reply, its block is noted as one that is being left.
    fn end(&self, imports: &SharedImports, leaving: &mut Leaving) -> Option<Arc<Block>> {
        let block = imports.lock().take(self.import?)?;
        if self.owner == Owner::Daemon {
            leaving.push((self.range(), Arc::downgrade(&block)));
        }
        Some(block)
    }
}

/// Blocks of replies that are being left, with their ranges: frames under way may know them.
type Leaving = Vec<(Range<usize>, Weak<Block>)>;

/// Pieces of memory that are remembered: three frames of each of some dozens of clients, and as
/// many replies. The oldest is forgotten beyond, and imported again when it comes back.
const OFFERED_LIMIT: usize = 128;

pub(super) struct Offers {
    gpu: Arc<Gpu>,
    imports: SharedImports,
    offered: Vec<Offered>,
    leaving: Leaving,
}

/// Blocks of imports that have ended. Frames that were recorded for them are to be dropped.
type Forgotten = Vec<Arc<Block>>;

impl Offers {
    /// Nothing yet. Engines that share `imports` find what is offered.
    pub(super) fn new(gpu: &Arc<Gpu>, imports: SharedImports) -> Self {
        Self { gpu: Arc::clone(gpu), imports, offered: Vec::new(), leaving: Vec::new() }
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
            // the engines live, or until `leave` has ended this import.
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
        let Self { imports, offered, leaving, .. } = self;
        let mut forget = |offered: &Offered| forgotten.extend(offered.end(imports, leaving));
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

    /// Ends the imports of replies that reach into a range of addresses.
    #[must_use]
    pub(super) fn leave(&mut self, range: &Range<usize>) -> Forgotten {
        let Self { imports, offered, leaving, .. } = self;
        let reaches = |o: &Offered| o.owner == Owner::Daemon && overlap(&o.range(), range);
        let ended = offered.extract_if(.., |offered| reaches(offered));
        ended.filter_map(|offered| offered.end(imports, leaving)).collect()
    }

    /// Whether nothing knows a block any more that was [left](Self::leave) in a range of addresses. The device has
    /// let go of its pages then.
    pub(super) fn has_left(&mut self, range: &Range<usize>) -> bool {
        self.leaving.retain(|(_, block)| block.strong_count() > 0);
        !self.leaving.iter().any(|(its, _)| overlap(its, range))
    }

    /// Gives up memory whose owner is gone; to be called now and then.
    #[must_use]
    pub(super) fn tidy(&mut self) -> Forgotten {
        let Self { imports, offered, leaving, .. } = self;
        leaving.retain(|(_, block)| block.strong_count() > 0);
        let is_gone = |o: &Offered| o.import.is_some_and(|i| imports.lock().is_orphaned(i));
        let ended = offered.extract_if(.., |offered| is_gone(offered));
        ended.filter_map(|offered| offered.end(imports, leaving)).collect()
    }
}

fn overlap(one: &Range<usize>, other: &Range<usize>) -> bool {
    one.start < other.end && other.start < one.end
}
