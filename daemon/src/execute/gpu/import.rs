//! Mappings that a GPU can import.
//!
//! The daemon maps a client's segment read-only, and NVIDIA's driver refuses read-only pages. So
//! the file behind an address is looked up in the process's table of mappings and the same pages are mapped a
//! second time, read-write, for the import alone. That mapping belongs to the import: it stays
//! valid when the first one goes, but then shows a file that is not in use, so
//! [`Imports::discard`] it.
//!
//! Stages read from every import. They write only to those that were imported for replies, which is
//! `unsafe`: a reply is found by its address, so the address must not come to mean other memory.
#![allow(unsafe_code)]

use std::fs::{File, Metadata, OpenOptions};
use std::io;
use std::ops::Range;
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::{Arc, Weak};

use pairmask_core::objects::Objects;
use pairmask_transport::Mapping;
use rustix::mm::{MapFlags, ProtFlags};

use super::{Block, Gpu, GpuError};
use crate::execute::frame_memory::LentReply;

/// Pages of this process, read-write, unmapped on drop.
#[derive(Debug)]
pub struct ReadWriteMapping {
    pointer: NonNull<u8>,
    bytes: usize,
}

// SAFETY: a mapping belongs to the process, not to a thread; nothing here follows the pointer.
unsafe impl Send for ReadWriteMapping {}
// SAFETY: as above.
unsafe impl Sync for ReadWriteMapping {}

/// Size of a page of host memory, and the unit of imports.
pub const PAGE_BYTES: usize = 4096;

impl ReadWriteMapping {
    /// A shared mapping of a file, from byte `offset`, a multiple of a page.
    pub fn of_file(file: &File, offset: u64, bytes: usize) -> io::Result<Self> {
        let bytes = bytes.max(1).next_multiple_of(PAGE_BYTES);
        let (prot, flags) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED);
        // SAFETY: the kernel chooses a free address.
        let pointer = unsafe {
            rustix::mm::mmap(std::ptr::null_mut(), bytes, prot, flags, file.as_fd(), offset)
        }?;
        let pointer = NonNull::new(pointer.cast()).ok_or(io::ErrorKind::AddrNotAvailable)?;
        Ok(Self { pointer, bytes })
    }

    /// The pages behind an address range of this process, read-write regardless of the first mapping
    /// allows. Covers whole pages around the range.
    pub fn behind(address: usize, bytes: usize) -> Result<Self, SegmentError> {
        let start = page_start(address);
        let end = address.checked_add(bytes).ok_or(SegmentError::NotMapped)?;
        let segment = segment_around(start, end)?;
        let file = open_file(&segment)?;
        let offset = segment.file_offset + (start - segment.start) as u64;
        Ok(Self::of_file(&file, offset, end - start)?)
    }

    pub fn pointer(&self) -> NonNull<u8> {
        self.pointer
    }

    /// Size, whole pages.
    pub fn bytes(&self) -> usize {
        self.bytes
    }
}

impl Drop for ReadWriteMapping {
    fn drop(&mut self) {
        // SAFETY: the range was mapped by this value, and nothing refers into it any more: a block
        // that imported it frees its memory before it drops its mapping.
        let unmapped = unsafe { rustix::mm::munmap(self.pointer.as_ptr().cast(), self.bytes) };
        debug_assert!(unmapped.is_ok(), "a mapping of ours is always there to unmap");
    }
}

#[derive(Debug, thiserror::Error)]
pub enum SegmentError {
    #[error("the address range is not within one mapping")]
    NotMapped,
    /// Private memory: it has no file, so it cannot be mapped twice.
    #[error("the address range is not shared memory")]
    NotShared,
    #[error("the file behind the mapping is not to be found: {0}")]
    FileGone(PathBuf),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The shared mapping that holds an address range.
fn segment_around(start: usize, end: usize) -> Result<Mapping, SegmentError> {
    match Mapping::around(start)? {
        Some(mapping) if end <= mapping.end && mapping.is_shared => Ok(mapping),
        Some(mapping) if end <= mapping.end => Err(SegmentError::NotShared),
        _ => Err(SegmentError::NotMapped),
    }
}

/// Opens a mapping's file read-write: by its path, or, when the name no longer exists (memfd, an unlinked segment), through a
/// descriptor that is still open.
fn open_file(mapping: &Mapping) -> Result<File, SegmentError> {
    let is_it = |data: &Metadata| (data.dev(), data.ino()) == (mapping.device, mapping.inode);
    let open = |path: &Path| -> Option<File> {
        let file = OpenOptions::new().read(true).write(true).open(path).ok()?;
        // The name may have been given to another file since.
        is_it(&file.metadata().ok()?).then_some(file)
    };
    let path = Path::new(&mapping.path);
    if let Some(file) = open(path) {
        return Ok(file);
    }
    for entry in std::fs::read_dir("/proc/self/fd")?.flatten() {
        let same = std::fs::metadata(entry.path()).is_ok_and(|data| is_it(&data));
        if let Some(file) = same.then(|| open(&entry.path())).flatten() {
            return Ok(file);
        }
    }
    Err(SegmentError::FileGone(path.to_owned()))
}

/// Whose memory an address is. Memory of one owner stays mapped at its address as long as the owner lives; that of another
/// may come to lie there later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// A client's segment, by its unique number.
    Client(u64),
    /// Memory that stays until its import is discarded.
    Caller,
    Daemon,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImportId(u64);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    /// Of memory of this process alone.
    Write,
}

struct Import {
    id: ImportId,
    owner: Owner,
    /// What was asked for.
    range: Range<usize>,
    /// The whole pages around it. `None` where the driver or the system refused: the staged path serves, and the import
    /// is not tried again.
    block: Option<Arc<Block>>,
}

/// Pieces of memory that are remembered: three frames of each of some dozens of clients, and as
/// many replies. The oldest is dropped beyond, and imported again when it comes back.
const OFFERED_LIMIT: usize = 128;

/// Address ranges whose pages a GPU has imported. An import costs 0.2 to 10 ms, once for each piece of memory: the first
/// frame in it is staged or waits for the import; every later one needs no copy.
#[derive(Default)]
pub struct Imports {
    all: Vec<Import>,
    next: u64,
    /// Blocks of replies that are being left, with their ranges: frames under way may know them.
    leaving: Vec<(Range<usize>, Weak<Block>)>,
}

/// Blocks of imports that have ended. Frames that were recorded for them are to be dropped.
type Discarded = Vec<Arc<Block>>;

/// An address range was not imported; the staged path serves it.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    #[error(transparent)]
    Segment(#[from] SegmentError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl Imports {
    /// Imports the pages behind an address range of this process, which must be shared memory, for
    /// stages to read boxes from. The range's pages become resident: import what is used, not a
    /// whole sparse segment.
    ///
    /// Until [`Self::discard`], boxes at these addresses are taken to be these pages. Where the
    /// range is mapped anew before, frames read what lies in the former pages: a wrong answer, and
    /// no harm to memory.
    pub fn import_boxes(
        &mut self,
        gpu: &Arc<Gpu>,
        address: usize,
        bytes: usize,
    ) -> Result<ImportId, ImportError> {
        let block = block_behind(gpu, address, bytes)?;
        Ok(self.add(Owner::Caller, address..address + bytes, Some(block)))
    }

    /// As [`Self::import_boxes`], for stages to write replies to as well.
    ///
    /// # Safety
    /// Until [`Self::discard`], the range stays mapped to the pages that it is mapped to now,
    /// or no reply lends memory at these addresses. Otherwise a frame writes to pages that
    /// its reply does not borrow.
    pub unsafe fn import_replies(
        &mut self,
        gpu: &Arc<Gpu>,
        address: usize,
        bytes: usize,
    ) -> Result<ImportId, ImportError> {
        let block = block_behind(gpu, address, bytes)?;
        Ok(self.add(Owner::Daemon, address..address + bytes, Some(block)))
    }

    fn add(&mut self, owner: Owner, range: Range<usize>, block: Option<Arc<Block>>) -> ImportId {
        let id = ImportId(self.next);
        self.next += 1;
        self.all.push(Import { id, owner, range, block });
        id
    }

    /// Ends an import: from now on nothing is found at its addresses.
    pub fn discard(&mut self, id: ImportId) -> Discarded {
        self.end(|import| import.id == id)
    }

    fn end(&mut self, is_meant: impl Fn(&Import) -> bool) -> Discarded {
        let mut discarded = Discarded::new();
        for Import { owner, range, block, .. } in self.all.extract_if(.., |i| is_meant(i)) {
            if let Some(block) = block {
                if owner == Owner::Daemon {
                    self.leaving.push((range, Arc::downgrade(&block)));
                }
                discarded.push(block);
            }
        }
        discarded
    }

    #[must_use]
    pub(in crate::execute) fn offer_objects(
        &mut self,
        gpu: &Arc<Gpu>,
        owner: Owner,
        objects: Objects<'_>,
    ) -> Discarded {
        let memory = objects.as_bytes().as_ptr_range();
        self.offer(gpu, owner, memory.start as usize..memory.end as usize)
    }

    /// Imports memory that a reply lent unless it is known, so that the next mask in it needs no copy.
    ///
    /// What [`Self::import_replies`] asks for holds: the reply of a `FrameMemory` lent this range, and only one makes a
    /// [`LentReply`]. Shared memory that it lends stays mapped to the same pages as long as the engines live, or until
    /// [`Self::leave`] has ended this import.
    #[must_use]
    pub(in crate::execute) fn offer_reply(&mut self, gpu: &Arc<Gpu>, lent: LentReply) -> Discarded {
        self.offer(gpu, Owner::Daemon, lent.range())
    }

    fn offer(&mut self, gpu: &Arc<Gpu>, owner: Owner, range: Range<usize>) -> Discarded {
        let known = |import: &Import| {
            let its = &import.range;
            import.owner == owner && its.start <= range.start && range.end <= its.end
        };
        if range.is_empty() || self.all.iter().any(known) {
            return Discarded::new();
        }
        // All else that was known of these addresses no longer exists, or too short.
        let mut discarded = self.end(|import| overlap(&import.range, &range));
        if let Some(oldest) = self.all.first().filter(|_| self.all.len() >= OFFERED_LIMIT) {
            discarded.append(&mut self.discard(oldest.id));
        }
        let block = block_behind(gpu, range.start, range.len())
            .inspect_err(|error| log::debug!("staging instead of importing: {error}"))
            .ok();
        self.add(owner, range, block);
        discarded
    }

    #[must_use]
    pub(in crate::execute) fn leave(&mut self, range: &Range<usize>) -> Discarded {
        self.end(|import| import.owner == Owner::Daemon && overlap(&import.range, range))
    }

    /// Whether nothing knows a block any more that was [left](Self::leave) in a range of addresses. The device has
    /// let go of its pages then.
    pub(in crate::execute) fn has_left(&mut self, range: &Range<usize>) -> bool {
        self.leaving.retain(|(_, block)| block.strong_count() > 0);
        !self.leaving.iter().any(|(its, _)| overlap(its, range))
    }

    /// Ends the imports of clients whose segments are none of these.
    #[must_use]
    pub(in crate::execute) fn tidy(&mut self, segments: &[u64]) -> Discarded {
        self.leaving.retain(|(_, block)| block.strong_count() > 0);
        let is_mapped = |owner| match owner {
            Owner::Client(segment) => segments.contains(&segment),
            Owner::Caller | Owner::Daemon => true,
        };
        self.end(|import| !is_mapped(import.owner))
    }

    /// The imported block behind an address range, and the offset of the range in it. For writing,
    /// only what was imported for replies is found.
    pub(super) fn find(
        &self,
        address: usize,
        bytes: usize,
        access: Access,
    ) -> Option<(&Arc<Block>, u64)> {
        let allows = |i: &&Import| access == Access::Read || i.owner == Owner::Daemon;
        self.all.iter().filter(allows).find_map(|import| {
            let block = import.block.as_ref()?;
            let offset = address.checked_sub(page_start(import.range.start))? as u64;
            (offset.checked_add(bytes as u64)? <= block.bytes()).then_some((block, offset))
        })
    }
}

const fn page_start(address: usize) -> usize {
    address / PAGE_BYTES * PAGE_BYTES
}

fn block_behind(gpu: &Arc<Gpu>, address: usize, bytes: usize) -> Result<Arc<Block>, ImportError> {
    Ok(Block::import(gpu, ReadWriteMapping::behind(address, bytes)?)?)
}

fn overlap(one: &Range<usize>, other: &Range<usize>) -> bool {
    one.start < other.end && other.start < one.end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_only_mapping_is_mapped_again_read_write_named_or_not() {
        for unlink in [false, true] {
            let path = PathBuf::from(format!("/dev/shm/pairmask-test-{}", std::process::id()));
            let file = File::create_new(&path).expect("shared memory is writable");
            file.set_len(3 * PAGE_BYTES as u64).expect("room");
            let file = OpenOptions::new().read(true).write(true).open(&path).expect("just made");
            let first = ReadWriteMapping::of_file(&file, 0, 3 * PAGE_BYTES).expect("maps");
            std::fs::remove_file(&path).ok().filter(|()| unlink);
            let address = first.pointer().as_ptr() as usize + PAGE_BYTES + 24;
            let second = ReadWriteMapping::behind(address, 100).expect("maps again");
            assert_eq!(second.bytes(), PAGE_BYTES);
            // SAFETY: both mappings are live and as long as the accesses.
            unsafe {
                second.pointer().as_ptr().add(24).write_volatile(7);
                assert_eq!((address as *const u8).read_volatile(), 7);
            }
            std::fs::remove_file(&path).ok();
        }
    }

    /// A pipe, or a file of another disk, may have the number of an unlinked segment.
    #[test]
    fn a_file_of_another_file_system_is_not_taken_for_the_segment() {
        let (memory, _other_end) = std::io::pipe().expect("a pipe");
        let memory = File::from(std::os::fd::OwnedFd::from(memory));
        let data = memory.metadata().expect("of a pipe");
        let mut segment = Mapping {
            start: 0,
            end: PAGE_BYTES,
            is_shared: true,
            file_offset: 0,
            device: data.dev(),
            inode: data.ino(),
            path: "/dev/shm/gone (deleted)".into(),
        };
        assert!(open_file(&segment).is_ok(), "by its descriptor");
        segment.device += 1;
        assert!(matches!(open_file(&segment), Err(SegmentError::FileGone(_))));
    }

    #[test]
    fn private_and_unmapped_ranges_are_refused() {
        let private = vec![0u8; 64 * PAGE_BYTES];
        let address = private.as_ptr() as usize;
        assert!(matches!(
            ReadWriteMapping::behind(address, 8),
            Err(SegmentError::NotShared | SegmentError::NotMapped)
        ));
        assert!(matches!(ReadWriteMapping::behind(usize::MAX, 8), Err(SegmentError::NotMapped)));
    }
}
