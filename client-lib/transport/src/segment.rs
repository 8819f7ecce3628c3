//! Bounds of a sender's shared memory, by the kernel.
//!
//! Lengths and offsets in shared memory are the sender's claims. The kernel gives the size of the
//! sender's segment and its address in this process. Every part of a message is checked against those
//! before it is read.
//!
//! A segment that its owner truncates after the check still kills the process that reads it (SIGBUS).
//! Only the system could forbid that.

use std::fs::{File, Metadata};
use std::os::unix::fs::MetadataExt;

use pairmask_wire::InstanceName;
use rustix::fs::makedev;

use crate::instance::RuntimeDir;

/// Messages of this many bytes or more have the size of their segment's file read again. That takes
/// up to 1 µs, at most 1 % of such a frame. Smaller messages are checked against the size that was
/// read first.
const MEASURED_AGAIN_BYTES: usize = 256 << 10;

/// Names of the segment files of an instance's ports.
#[derive(Clone, Debug)]
pub struct SegmentFiles {
    prefix: String,
}

impl SegmentFiles {
    /// The segment files of an instance.
    pub fn new(dir: &RuntimeDir, name: &InstanceName) -> Self {
        Self { prefix: format!("/dev/shm/{}", dir.shm_prefix(name)) }
    }

    /// The segment of a port, mapped around `address` in this process; `None` where that address
    /// belongs to another mapping.
    ///
    /// Reads the process's table of mappings: 50 µs or more, once a port.
    pub fn find(&self, port: u128, address: usize) -> Option<Segment> {
        // Between prefix and port the transport writes the kind of the file.
        let ending = format!("_{port}.data");
        let mapping = Mapping::around(address).ok()??;
        let Mapping { start, end, file_offset, inode, path, .. } = mapping;
        if !path.starts_with(&self.prefix) || !path.ends_with(&ending) {
            return None;
        }
        // The file of a port that was closed meanwhile has no name any more: only the mapping gives
        // its size.
        let found = File::open(path).ok().and_then(|file| Some((file.metadata().ok()?, file)));
        let Some((data, file)) = found.filter(|(data, _)| data.ino() == inode) else {
            return Some(Segment { start, end, file_offset, file: None });
        };
        let bytes = usize::try_from(data.len().saturating_sub(file_offset)).ok()?;
        let end = end.min(start.checked_add(bytes)?);
        Some(Segment { start, end, file_offset, file: Some(file) })
    }
}

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
        let maps = std::fs::read_to_string("/proc/self/maps")?;
        let mut all = maps.lines().filter_map(Self::parse);
        Ok(all.find(|mapping| (mapping.start..mapping.end).contains(&address)))
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

/// The memory of one port, as mapped in this process.
#[derive(Debug)]
pub struct Segment {
    start: usize,
    end: usize,
    file_offset: u64,
    file: Option<File>,
}

impl Segment {
    /// Whether `bytes` bytes from `address` on lie within the segment.
    pub fn holds(&self, address: usize, bytes: usize) -> bool {
        let Some(end) = address.checked_add(bytes) else { return false };
        if address < self.start || end > self.end {
            return false;
        }
        bytes < MEASURED_AGAIN_BYTES || self.reaches(end)
    }

    /// Whether the file still reaches as far as `end`.
    fn reaches(&self, end: usize) -> bool {
        let needed = self.file_offset + (end - self.start) as u64;
        let is_long_enough = |data: Metadata| data.len() >= needed;
        self.file.as_ref().is_none_or(|file| file.metadata().is_ok_and(is_long_enough))
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
