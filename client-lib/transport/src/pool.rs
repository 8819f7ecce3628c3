//! Memory of this process that the other side reads: pages that the transport lends, in one segment.
//!
//! A pool is a publisher of a service that nobody else opens: iceoryx2 makes the segment and divides it into
//! pieces. The other side gets a descriptor of the segment's file that reads and does not write, and maps it by
//! itself. None of iceoryx2's own bookkeeping is shared with it ([`make_private`]): what another process writes, nobody
//! here takes for an offset or a length.
//!
//! The files lose their names as soon as they are made. Nothing of a pool is left when its process ends, however
//! it ends, and no other process can open or cut the segment by a name.
#![allow(unsafe_code)]

use std::fs::{self, File};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::mem::MaybeUninit;
use std::ops::Range;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{
    AllocationStrategy, FileName, Path as TransportPath, SemanticString, ServiceName,
    SignalHandlingMode,
};
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::ipc_threadsafe::Service;
use pairmask_wire::{PAGE_BYTES, Page};
use rustix::mm::{Advice, MapFlags, ProtFlags, madvise, mmap_anonymous};

use crate::budget::{Charge, Memory, Share};
use crate::error::{OpenError, TransportError};
use crate::fork::Maker;
use crate::guard::Guarded;
use crate::instance::{SHM_DIR, shared_files};
use crate::locked::lock;
use crate::memory::populate_beyond;
use crate::process_limits;
use crate::room::{self, PopulateError};
use crate::segment::Mapping;

type Loan = SampleMutUninit<Service, [MaybeUninit<Page>], ()>;

/// Memory up to this size stays in a piece that nobody uses: most answers take one page.
const KEPT_BYTES: usize = PAGE_BYTES;

/// Pieces of equal size in one segment, lent one by one.
#[derive(Clone, Debug)]
pub struct Pool(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    // Pieces before the publisher that they belong to: fields drop in this order.
    free: Mutex<Free>,
    /// Before what it watches over.
    _guarded: Option<Guarded>,
    _publisher: Publisher<Service, [Page], ()>,
    file: File,
    /// Where the segment's file begins.
    start: usize,
    /// Where it is mapped. Its file may be cut by who has a descriptor of it.
    range: Range<usize>,
    pages: usize,
}

#[derive(Debug, Default)]
struct Free {
    pieces: Vec<Piece>,
    /// Whether pieces that come back are dropped.
    is_retired: bool,
}

impl Free {
    /// The piece that came back last of those that have so many bytes present, else the last one.
    fn take(&mut self, bytes: usize) -> Option<Piece> {
        let at = self.pieces.iter().rposition(|piece| piece.present >= bytes);
        Some(self.pieces.remove(at.or(self.pieces.len().checked_sub(1))?))
    }
}

/// A piece of a segment. Dropped, its pages go back to the system.
struct Piece {
    /// Boxed: a chunk is moved with each frame.
    _loan: Box<Loan>,
    /// Address of its first page.
    first: usize,
    /// Bytes that are present, from the first page on.
    present: usize,
    /// When more than half of them were needed last.
    needed_at: Instant,
    maker: Maker,
    /// For what is present, beside the page that stays; `None` where nobody counts.
    charge: Option<Charge>,
}

// SAFETY: nothing is done with a loan by reference: it is held, and dropped by its owner.
unsafe impl Sync for Piece {}

impl std::fmt::Debug for Piece {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Piece").field("present", &self.present).finish_non_exhaustive()
    }
}

impl Piece {
    /// Gives the pages that are present back to the system: they read as zeros, and become present again when they are
    /// written to.
    fn remove_pages(&mut self) {
        if self.present > 0 {
            // SAFETY: the pages are those of a piece that this value holds alone, in a shared mapping that lives as
            // long as the loan. Nothing refers into them: a chunk has given the piece back.
            let removed =
                unsafe { madvise(self.first as *mut _, self.present, Advice::LinuxRemove) };
            match removed {
                Ok(()) => self.present = 0,
                Err(error) => log::debug!("{} bytes of shared memory stay: {error}", self.present),
            }
        }
        if let Some(charge) = &mut self.charge {
            charge.set(charged(self.present));
        }
    }
}

/// What is charged for so many bytes that are present: a page is free, so that any answer has room that is small, and says
/// why there is no other.
const fn charged(present: usize) -> u64 {
    present.saturating_sub(KEPT_BYTES) as u64
}

impl Drop for Piece {
    fn drop(&mut self) {
        // The other side may hold the segment mapped for long. A child of this process that ends has part in the memory
        // too, and leaves it to its parent.
        if self.maker.is_here_by_its_id() {
            self.remove_pages();
        }
    }
}

/// Pages that are lent. Dropped, they go back to their pool.
#[derive(Debug)]
pub struct Chunk {
    /// `None` only while it is dropped.
    piece: Option<Piece>,
    first: usize,
    pages: usize,
    pool: Arc<Inner>,
}

impl Pool {
    /// Makes a segment of `count` pieces of `pages` pages, in files whose names begin with `prefix` until they have
    /// none. Address space, not memory: pages cost when they are touched, and are charged to the share of a client if
    /// there is one.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn new(
        prefix: &str,
        pages: usize,
        count: usize,
        share: Option<&Share>,
    ) -> Result<Self, OpenError> {
        room::for_pool().map_err(|_| OpenError::OutOfMemory)?;
        let prefix = format!("{prefix}{:016x}_", RandomState::new().build_hasher().finish());
        let root = Path::new(SHM_DIR).join(&prefix);
        let made = publisher(&prefix, &root, pages, count).and_then(|publisher| {
            let pieces: Result<Vec<_>, _> =
                (0..count).map(|_| Piece::of(&publisher, pages, share)).collect();
            let pieces = pieces?;
            // The first piece shows where the segment is mapped.
            let failed = |e: std::io::Error| TransportError::new("finding a segment", &e);
            let first = pieces.first().map_or(0, |piece| piece.first);
            let all = Mapping::all().map_err(failed)?;
            let mapping = all.iter().find(|of| (of.start..of.end).contains(&first));
            let mapping = mapping.ok_or_else(|| TransportError::new("finding a segment", &()))?;
            let file = File::open(&mapping.path).map_err(failed)?;
            let range = mapping.start..mapping.end;
            let guarded = Guarded::watch(range.start, range.len(), true).map_err(failed)?;
            let named = Path::new(SHM_DIR).join(&prefix);
            let is_its =
                |of: &Mapping| of.path.as_bytes().starts_with(named.as_os_str().as_bytes());
            for its in all.iter().filter(|of| is_its(of)) {
                let pieces = if its.start == mapping.start { &pieces[..] } else { &[] };
                make_private(its, pieces, pages * PAGE_BYTES).map_err(failed)?;
            }
            let start = mapping.start - mapping.file_offset as usize;
            let free = Mutex::new(Free { pieces, is_retired: false });
            Ok(Inner { free, _guarded: guarded, _publisher: publisher, file, start, range, pages })
        });
        for named in shared_files(&prefix) {
            // What is mapped stays, with no name.
            let _ = fs::remove_file(named.path());
        }
        let _ = fs::remove_dir_all(root);
        let bytes = pages.saturating_mul(count).saturating_mul(PAGE_BYTES) as u64;
        let inner = made.map_err(|error| {
            process_limits::behind(bytes).map_or_else(|| error.into(), OpenError::Limit)
        })?;
        Ok(Self(Arc::new(inner)))
    }

    /// A descriptor of the segment that reads.
    pub fn file(&self) -> &File {
        &self.0.file
    }

    /// Pages of a piece.
    pub fn pages(&self) -> usize {
        self.0.pages
    }

    /// Lends pages, at most those of a piece. The piece that came back last is lent first, its memory is warm, unless another
    /// one has them present.
    ///
    /// # Errors
    /// [`PopulateError`] where no piece is left, or no memory, or the client may have no more of it.
    pub fn lend(&self, pages: usize) -> Result<Chunk, PopulateError> {
        self.lend_while(pages, || true)
    }

    /// As [`lend`](Self::lend), for somebody who may not want them any more before all are present.
    ///
    /// # Errors
    /// As [`lend`](Self::lend), and where they are not wanted.
    pub fn lend_while(
        &self,
        pages: usize,
        is_wanted: impl Fn() -> bool,
    ) -> Result<Chunk, PopulateError> {
        let bytes = pages * PAGE_BYTES;
        let none = PopulateError { bytes: bytes as u64 };
        if pages > self.0.pages {
            return Err(none);
        }
        let mut piece = lock(&self.0.free).take(bytes).ok_or(none)?;
        let charge = piece.charge.as_mut();
        if charge.is_some_and(|charge| charge.grow_to(charged(bytes)).is_err()) {
            // What is present of it stays charged.
            lock(&self.0.free).pieces.push(piece);
            return Err(none);
        }
        let (first, present) = (piece.first, piece.present);
        let mut chunk = Chunk { piece: Some(piece), first, pages, pool: Arc::clone(&self.0) };
        let populated = populate_beyond(chunk.pages_mut(), present, is_wanted);
        if let Some(piece) = &mut chunk.piece {
            piece.present = present.max(bytes);
            if 2 * bytes > piece.present {
                piece.needed_at = Instant::now();
            }
            if populated.is_err() {
                // Some pages may have become present before there was no more memory.
                piece.remove_pages();
            }
        }
        populated.map(|()| chunk)
    }

    /// Has pieces that come back dropped: another pool takes this one's place.
    pub fn retire(&self) {
        let mut free = lock(&self.0.free);
        free.is_retired = true;
        let dropped = std::mem::take(&mut free.pieces);
        drop(free);
        drop(dropped);
    }

    /// Gives pages back to the system of pieces that nobody has, and that nobody needed for so long. `release` has
    /// others let go of a range of addresses, and says whether they did.
    pub fn tidy(&self, idle: Duration, mut release: impl FnMut(&Range<usize>) -> bool) {
        let now = Instant::now();
        let mut kept = 0;
        loop {
            // Taken out, so that nobody is lent it meanwhile, and put back below the others.
            let is_due = |piece: &Piece| {
                piece.present > KEPT_BYTES && now.saturating_duration_since(piece.needed_at) >= idle
            };
            let mut free = lock(&self.0.free);
            let Some(at) = (kept..free.pieces.len()).find(|at| is_due(&free.pieces[*at])) else {
                return;
            };
            let mut piece = free.pieces.remove(at);
            drop(free);
            if release(&(piece.first..piece.first + piece.present)) {
                piece.remove_pages();
            }
            let mut free = lock(&self.0.free);
            free.pieces.insert(0, piece);
            kept += 1;
        }
    }

    /// Where the segment's pieces lie in this process.
    pub fn range(&self) -> Range<usize> {
        self.0.range.clone()
    }
}

impl Piece {
    fn of(
        publisher: &Publisher<Service, [Page], ()>,
        pages: usize,
        share: Option<&Share>,
    ) -> Result<Self, TransportError> {
        let mut loan = publisher
            .loan_slice_uninit(pages)
            .map_err(|e| TransportError::new("lending memory", &e))?;
        let first = loan.payload_mut().as_mut_ptr().expose_provenance();
        Ok(Self {
            _loan: Box::new(loan),
            first,
            present: 0,
            needed_at: Instant::now(),
            maker: Maker::here(),
            charge: share.map(|share| share.nothing(Memory::Shared)),
        })
    }
}

/// Takes what is not lent out of a mapping: iceoryx2 keeps its bookkeeping there, beside and between the pieces, and goes by
/// what it reads in it. From now on it reads memory that no other process has. For the millisecond before, the files have
/// names, by which a process of this user could open them.
fn make_private(mapping: &Mapping, pieces: &[Piece], bytes: usize) -> std::io::Result<()> {
    let mut firsts: Vec<usize> = pieces.iter().map(|piece| piece.first).collect();
    firsts.sort_unstable();
    let ends = firsts.iter().map(|first| first + bytes);
    let starts = std::iter::once(mapping.start).chain(ends);
    for (start, end) in starts.zip(firsts.iter().copied().chain([mapping.end])) {
        let bytes = end.saturating_sub(start);
        if bytes == 0 {
            continue;
        }
        let own = || std::ptr::with_exposed_provenance_mut::<std::ffi::c_void>(start);
        let (access, flags) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::PRIVATE);
        // SAFETY: the pages are those of a mapping of this process, between pieces that are lent. No other thread of it
        // knows them yet, and their bytes are put back before this one goes on. They stay mapped where they are.
        unsafe {
            let kept = std::slice::from_raw_parts(own().cast::<u8>(), bytes).to_vec();
            madvise(own(), bytes, Advice::LinuxRemove)?;
            mmap_anonymous(own(), bytes, access, flags | MapFlags::FIXED)?;
            std::slice::from_raw_parts_mut(own().cast::<u8>(), bytes).copy_from_slice(&kept);
        }
    }
    Ok(())
}

/// A publisher of a service of its own, in a domain of its own: its files and those of its node begin with `prefix`,
/// or lie in `root`.
fn publisher(
    prefix: &str,
    root: &Path,
    pages: usize,
    count: usize,
) -> Result<Publisher<Service, [Page], ()>, TransportError> {
    let mut config = Config::default();
    let bad = |e| TransportError::new("naming the transport's files", &e);
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(bad)?;
    let root = TransportPath::new(root.as_os_str().as_encoded_bytes()).map_err(bad)?;
    config.global.set_root_path(&root);
    // Nobody else is there, dead or alive.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    let node = NodeBuilder::new()
        .config(&config)
        // The program handles signals, not the transport.
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Service>()
        .map_err(|e| TransportError::new("creating a node", &e))?;
    let name =
        ServiceName::new("pairmask").map_err(|e| TransportError::new("naming a service", &e))?;
    let service = node
        .service_builder(&name)
        .publish_subscribe::<[Page]>()
        .max_nodes(1)
        .max_publishers(1)
        .max_subscribers(1)
        .subscriber_max_buffer_size(1)
        .subscriber_max_borrowed_samples(1)
        .history_size(0)
        .create()
        .map_err(|e| TransportError::new("creating a service", &e))?;
    service
        .publisher_builder()
        // Dynamic growth is broken for alignments over 8 bytes: a larger piece is one of another pool.
        .allocation_strategy(AllocationStrategy::Static)
        .initial_max_slice_len(pages)
        .max_loaned_samples(count)
        // Nobody subscribes.
        .override_sample_preallocation(move |_| count)
        .create()
        .map_err(|e| TransportError::new("creating a segment", &e))
}

impl Chunk {
    /// The pages, as many as were lent.
    pub fn pages(&self) -> &[Page] {
        let first = std::ptr::with_exposed_provenance(self.first);
        // SAFETY: so many pages of a piece were lent here, in a mapping that stays as long as the pool, which is held.
        // They are aligned, and any bytes are a valid Page.
        unsafe { std::slice::from_raw_parts(first, self.pages) }
    }

    /// The pages, writable.
    pub fn pages_mut(&mut self) -> &mut [Page] {
        let first = std::ptr::with_exposed_provenance_mut(self.first);
        // SAFETY: as in `pages`; this value alone holds the piece, and the other side cannot write to it.
        unsafe { std::slice::from_raw_parts_mut(first, self.pages) }
    }

    /// Where it begins in the segment's file, bytes.
    pub fn offset(&self) -> u64 {
        (self.first - self.pool.start) as u64
    }

    /// Lets go of pages that the other side may still read: they stay as they are until that has let go of the segment too.
    pub fn leave(mut self) {
        if let Some(piece) = &mut self.piece {
            piece.present = 0;
        }
    }

    /// Whether it is of this pool.
    pub fn is_of(&self, pool: &Pool) -> bool {
        Arc::ptr_eq(&self.pool, &pool.0)
    }
}

impl Drop for Chunk {
    fn drop(&mut self) {
        let Some(piece) = self.piece.take() else { return };
        if !piece.maker.is_here() {
            // Another thread of the parent may have had the lock, which nobody gives back in its child.
            std::mem::forget(piece);
            return;
        }
        let mut free = lock(&self.pool.free);
        if !free.is_retired {
            free.pieces.push(piece);
        }
    }
}
