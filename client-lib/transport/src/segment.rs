//! How far the memory of a sender reaches.
//!
//! Lengths and places that stand in shared memory are what the sender says. How large its segment is,
//! and where it is mapped, the kernel says: whatever is read of a message is held to that first.
//!
//! A segment that its owner cuts after it was looked at still kills whoever reads it (SIGBUS): nothing
//! but the system could forbid that.

use std::fs::{File, Metadata};
use std::os::unix::fs::MetadataExt;

use pairmask_wire::InstanceName;

use crate::instance::RuntimeDir;

/// A message of this size has its segment's file measured again, bytes. Measuring takes up to 1 µs,
/// which is 1 % of a frame of this size at most; smaller ones are held to what was measured first.
const MEASURED_AGAIN_BYTES: usize = 256 << 10;

/// Where the segments of an instance's ports are.
#[derive(Clone, Debug)]
pub struct SegmentFiles {
    prefix: String,
}

impl SegmentFiles {
    /// Those of an instance.
    pub fn new(dir: &RuntimeDir, name: &InstanceName) -> Self {
        Self { prefix: format!("/dev/shm/{}", dir.shm_prefix(name)) }
    }

    /// The segment of a port, as it is mapped around `address` of this process; `None` where that
    /// address belongs to something else.
    ///
    /// Reads the process's table of mappings: 50 µs and more, once a port.
    pub fn find(&self, port: u128, address: usize) -> Option<Segment> {
        // Between prefix and port stands what the transport makes of the kind of the file.
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
        // A port that was closed meanwhile has no name any more, and the mapping is all there is.
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

/// The memory of one port, as this process has it mapped.
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
