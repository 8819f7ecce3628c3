//! A recording, read block by block.

use std::io::{self, Read};

use bytemuck::{Pod, Zeroable};
use pairmask_wire::Version;

use super::block::{BlockHeader, Damage};
use super::record::Record;

/// "PMRD" in memory order.
pub(super) const FILE_MAGIC: u32 = u32::from_le_bytes(*b"PMRD");
/// Raised when an earlier reader would misread a recording.
const MAJOR: u16 = 1;
/// Raised when something is added that earlier readers pass over.
const MINOR: u16 = 0;

/// What a recording begins with.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct FileHeader {
    magic: u32,
    major: u16,
    minor: u16,
    wire_major: u16,
    wire_minor: u16,
    reserved: u32,
    /// When it began, ns since 1970.
    pub began_ns: u64,
    /// Zero.
    more: u64,
}

impl FileHeader {
    /// Of this build.
    pub const fn new(began_ns: u64) -> Self {
        let Version { major: wire_major, minor: wire_minor } = Version::CURRENT;
        let (magic, major, minor) = (FILE_MAGIC, MAJOR, MINOR);
        Self { magic, major, minor, wire_major, wire_minor, reserved: 0, began_ns, more: 0 }
    }
}

/// Why a recording is read no further. What came before is whole.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    #[error("this is no recording")]
    NoRecording,
    #[error(
        "a recording of version {major}, which this pairmaskd does not read: install a newer one"
    )]
    Version { major: u16 },
    #[error("the recording is cut behind byte {at}")]
    Cut { at: u64 },
    #[error("the recording is damaged behind byte {at}: {damage}")]
    Damaged { at: u64, damage: Damage },
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A recording. Whatever its bytes are, a block takes no more memory than the largest one that is written.
#[derive(Debug)]
pub struct Recording<R> {
    from: R,
    header: FileHeader,
    at: u64,
}

impl<R: Read> Recording<R> {
    pub fn open(mut from: R) -> Result<Self, ReadError> {
        let mut header = FileHeader::zeroed();
        if fill(&mut from, bytemuck::bytes_of_mut(&mut header))? < size_of::<FileHeader>()
            || header.magic != FILE_MAGIC
        {
            return Err(ReadError::NoRecording);
        }
        if header.major != MAJOR {
            return Err(ReadError::Version { major: header.major });
        }
        Ok(Self { from, header, at: size_of::<FileHeader>() as u64 })
    }

    /// Version of the wire contract of the daemon that made it.
    pub const fn wire(&self) -> Version {
        Version { major: self.header.wire_major, minor: self.header.wire_minor }
    }

    pub const fn began_ns(&self) -> u64 {
        self.header.began_ns
    }

    /// Bytes that were read, up to the end of a block.
    pub const fn at(&self) -> u64 {
        self.at
    }

    /// The records of the next block; `None` at the end. Not to be called after an error.
    pub fn next_block(&mut self) -> Result<Option<Vec<Record>>, ReadError> {
        let at = self.at;
        let damaged = |damage| ReadError::Damaged { at, damage };
        let mut header = BlockHeader::zeroed();
        match fill(&mut self.from, bytemuck::bytes_of_mut(&mut header))? {
            0 => return Ok(None),
            read if read < size_of::<BlockHeader>() => return Err(ReadError::Cut { at }),
            _ => {}
        }
        let bytes = header.packed_bytes().map_err(damaged)?;
        // Memory for what is there, regardless of what the header says.
        let mut packed = Vec::new();
        self.from.by_ref().take(bytes as u64).read_to_end(&mut packed)?;
        if packed.len() < bytes {
            return Err(ReadError::Cut { at });
        }
        let records = header.records(&packed).map_err(damaged)?;
        self.at += (size_of::<BlockHeader>() + bytes) as u64;
        Ok(Some(records))
    }
}

/// Fills a buffer as far as there are bytes. How many.
fn fill(from: &mut impl Read, mut to: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while !to.is_empty() {
        match from.read(to) {
            Ok(0) => break,
            Ok(read) => {
                filled += read;
                to = &mut to[read..];
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}
