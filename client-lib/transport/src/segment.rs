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
        let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
        let mapping = maps
            .lines()
            .filter_map(Mapping::parse)
            .find(|m| m.start <= address && address < m.end)?;
        let Mapping { start, end, file_offset, inode, path } = mapping;
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

/// A line of `/proc/self/maps`.
struct Mapping<'a> {
    start: usize,
    end: usize,
    file_offset: u64,
    inode: u64,
    path: &'a str,
}

impl<'a> Mapping<'a> {
    /// Parses `start-end permissions offset device inode path`.
    fn parse(line: &'a str) -> Option<Self> {
        let mut fields = line.split_ascii_whitespace();
        let (start, end) = fields.next()?.split_once('-')?;
        let file_offset = u64::from_str_radix(fields.nth(1)?, 16).ok()?;
        let inode = fields.nth(1)?.parse().ok()?;
        Some(Self {
            start: usize::from_str_radix(start, 16).ok()?,
            end: usize::from_str_radix(end, 16).ok()?,
            file_offset,
            inode,
            path: fields.next()?,
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
        let line = "7f00a000-7f00c000 rw-s 00001000 00:1b 4711    /dev/shm/x_1.data";
        let mapping = Mapping::parse(line).unwrap();
        let Mapping { start, end, file_offset, inode, path } = mapping;
        assert_eq!((start, end, file_offset, inode), (0x7f00_a000, 0x7f00_c000, 0x1000, 4711));
        assert_eq!(path, "/dev/shm/x_1.data");
        assert!(Mapping::parse("7f00a000-7f00c000 rw-p 00000000 00:00 0").is_none(), "no file");
    }
}
