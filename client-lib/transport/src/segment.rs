//! Memory of the other side, mapped by a descriptor of its own, and bounded by what the kernel says of its file.
//!
//! Offsets and lengths in shared memory are the other side's claims. Each is checked against the size of the mapping
//! before it is used. A file that its owner cuts afterwards is the [guard](crate::guard)'s.
#![allow(unsafe_code)]

use std::fs::File;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::ptr;
use std::sync::atomic::{AtomicU64, Ordering};

use pairmask_wire::{PAGE_BYTES, Page};
use rustix::fs::{FsWord, SeekFrom, fcntl_get_seals, fstatfs, makedev, seek};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

use crate::guard::Guarded;

/// A mapping of this process: a line of `/proc/self/maps`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// Its first address.
    pub start: usize,
    /// The address after its last one.
    pub end: usize,
    /// Whether other processes see what is written there.
    pub is_shared: bool,
    /// Where in its file it starts, bytes.
    pub file_offset: u64,
    /// The file system of the file: inode numbers are each file system's own.
    pub device: u64,
    /// The file's number.
    pub inode: u64,
    /// The file's name when it was mapped; empty without a file.
    pub path: String,
}

impl Mapping {
    /// The mapping around an address, if there is one. Takes 50 µs or more.
    ///
    /// # Errors
    /// Where the process may not read its own table.
    pub fn around(address: usize) -> std::io::Result<Option<Self>> {
        let mut all = Self::all()?.into_iter();
        Ok(all.find(|mapping| (mapping.start..mapping.end).contains(&address)))
    }

    /// All mappings of this process. As slow.
    ///
    /// # Errors
    /// As [`around`](Self::around).
    pub fn all() -> std::io::Result<Vec<Self>> {
        let maps = std::fs::read_to_string("/proc/self/maps")?;
        Ok(maps.lines().filter_map(Self::parse).collect())
    }

    /// Parses `start-end permissions offset device inode path`.
    fn parse(line: &str) -> Option<Self> {
        let mut fields = line.split_ascii_whitespace();
        let (start, end) = fields.next()?.split_once('-')?;
        let is_shared = fields.next()?.ends_with('s');
        let file_offset = u64::from_str_radix(fields.next()?, 16).ok()?;
        let (major, minor) = fields.next()?.split_once(':')?;
        let number = |hex| u32::from_str_radix(hex, 16).ok();
        Some(Self {
            start: usize::from_str_radix(start, 16).ok()?,
            end: usize::from_str_radix(end, 16).ok()?,
            is_shared,
            file_offset,
            device: makedev(number(major)?, number(minor)?),
            inode: fields.next()?.parse().ok()?,
            path: fields.next().unwrap_or_default().to_owned(),
        })
    }
}

/// The file system of shared memory.
const TMPFS_MAGIC: FsWord = 0x0102_1994;

/// What a file's blocks are counted in, by POSIX.
const BLOCK_BYTES: u64 = 512;

/// Segments that this process has mapped so far, for their numbers.
static MAPPED: AtomicU64 = AtomicU64::new(0);

/// A segment of the other side, mapped for reading.
#[derive(Debug)]
pub struct Segment {
    // Before the mapping that it watches over: fields drop in this order, and the mapping at the end of `drop`.
    guarded: Option<Guarded>,
    id: u64,
    start: usize,
    bytes: usize,
    /// Held open, since the file has no name: a GPU's import maps it by this descriptor.
    file: File,
}

impl Segment {
    /// Maps the file behind a descriptor for reading, of so many bytes at most.
    ///
    /// # Errors
    /// The system's, or where it is no shared memory with whole pages, or too large.
    pub fn map(file: OwnedFd, most: usize) -> std::io::Result<Self> {
        // Only memory has seals: who asks for the size of another file, or reads it, may wait for its owner. Huge
        // pages have them too; one that is missing could not be replaced.
        fcntl_get_seals(&file)?;
        if fstatfs(&file)?.f_type != TMPFS_MAGIC {
            return Err(std::io::ErrorKind::InvalidInput.into());
        }
        let file = File::from(file);
        let data = file.metadata()?;
        let bytes = usize::try_from(data.len()).unwrap_or(usize::MAX) / PAGE_BYTES * PAGE_BYTES;
        if bytes == 0 || bytes > most {
            return Err(std::io::ErrorKind::InvalidInput.into());
        }
        let flags = MapFlags::SHARED | MapFlags::NORESERVE;
        // SAFETY: the kernel chooses a free address.
        let start =
            unsafe { mmap(ptr::null_mut(), bytes, ProtFlags::READ, flags, file.as_fd(), 0) }?;
        let start = start.expose_provenance();
        let id = MAPPED.fetch_add(1, Ordering::Relaxed);
        let mut segment = Self { guarded: None, id, start, bytes, file };
        // Without a guard it is unmapped again.
        segment.guarded = Guarded::watch(start, bytes, false)?;
        Ok(segment)
    }

    /// A number that no other segment of this process has, or will have.
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// Its size.
    pub const fn bytes(&self) -> usize {
        self.bytes
    }

    /// Bytes of it that take memory; the others are holes. A third of a microsecond.
    pub fn present(&self) -> u64 {
        self.file.metadata().map_or(0, |data| data.blocks().saturating_mul(BLOCK_BYTES))
    }

    /// Whether a range of it has no holes. Some 15 ns a page.
    pub fn is_whole(&self, offset: u64, bytes: u64) -> bool {
        let end = offset.saturating_add(bytes);
        seek(&self.file, SeekFrom::Hole(offset)).is_ok_and(|hole| hole >= end)
    }

    /// Address of `bytes` bytes at a page of the segment; `None` where they do not lie in it.
    pub fn address(&self, offset: u64, bytes: usize) -> Option<usize> {
        let offset = usize::try_from(offset).ok()?;
        let end = offset.checked_add(bytes)?;
        (offset.is_multiple_of(PAGE_BYTES) && end <= self.bytes).then(|| self.start + offset)
    }

    /// Pages of the segment; none where `pages` pages do not lie in it.
    pub fn pages(&self, offset: u64, pages: u64) -> &[Page] {
        let bytes = usize::try_from(pages).ok().and_then(|pages| pages.checked_mul(PAGE_BYTES));
        let Some((address, bytes)) = bytes.and_then(|b| Some((self.address(offset, b)?, b))) else {
            return &[];
        };
        let first = ptr::with_exposed_provenance(address);
        // SAFETY: the pages lie within the mapping, as was checked, which stays as long as the segment. They are
        // aligned, and any bytes are a valid Page.
        unsafe { std::slice::from_raw_parts(first, bytes / PAGE_BYTES) }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        // What follows may be mapped at the same addresses.
        drop(self.guarded.take());
        // SAFETY: the range was mapped by this value, and what was lent of it borrowed the segment.
        let unmapped = unsafe { munmap(ptr::with_exposed_provenance_mut(self.start), self.bytes) };
        debug_assert!(unmapped.is_ok(), "a mapping of ours is there to unmap");
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_table_is_read() {
        let line = "7f00a000-7f00c000 r--s 00001000 00:1b 4711    /dev/shm/x_1.data";
        let mapping = Mapping::parse(line).unwrap();
        let Mapping { start, end, is_shared, file_offset, device, inode, path } = mapping;
        assert_eq!((start, end, file_offset, inode), (0x7f00_a000, 0x7f00_c000, 0x1000, 4711));
        assert_eq!(
            (path.as_str(), device, is_shared),
            ("/dev/shm/x_1.data", makedev(0, 0x1b), true)
        );
        let anonymous = Mapping::parse("7f00a000-7f00c000 rw-p 00000000 00:00 0").unwrap();
        assert!(!anonymous.is_shared && anonymous.path.is_empty());
        assert_eq!(Mapping::parse("nonsense"), None);
    }
}
