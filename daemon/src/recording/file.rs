//! A recording that is written, of bounded size.

use std::ffi::OsString;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use bytemuck::Zeroable;

use super::block::{BlockHeader, Filling};
use super::reader::{FILE_MAGIC, FileHeader, ReadError, Recording};
use super::record::{Event, Record};
use crate::file_error::{Access, FileError};

/// Where requests are recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordSettings {
    pub file: PathBuf,
    /// The file has no more bytes.
    pub most_bytes: u64,
}

impl RecordSettings {
    /// As flags of `serve`.
    pub(crate) fn flags(&self) -> [OsString; 2] {
        let mut file = OsString::from("--record=");
        file.push(&self.file);
        [file, format!("--record-max={}", self.most_bytes).into()]
    }
}

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{}: it is no recording, and is not overwritten: name another file", .0.display())]
    NoRecording(PathBuf),
}

/// What became of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    Done,
    /// The block is larger than what is left: the recording has ended.
    Full,
}

/// A recording that is being written. A block is written as a whole: what is there when the process is killed is read up
/// to its last whole block.
pub struct RecordFile {
    file: File,
    began_ns: u64,
    left_bytes: u64,
    filling: Filling,
}

impl RecordFile {
    /// Begins a recording, in place of one that has the same name.
    pub fn create(settings: &RecordSettings) -> Result<Self, RecordError> {
        let file = open(&settings.file)?;
        Self::begin(file, settings).map_err(|error| failed(settings, error))
    }

    /// One whose file takes no bytes.
    #[cfg(test)]
    pub(super) fn unwritable(path: &Path) -> Self {
        let file = File::open(path).expect("a file that is there");
        Self { file, began_ns: 0, left_bytes: u64::MAX, filling: Filling::default() }
    }

    /// Goes on with the recording of an earlier worker, behind its last whole block.
    pub fn go_on(settings: &RecordSettings) -> Result<Self, RecordError> {
        let mut file = open(&settings.file)?;
        let whole = whole_part(&file).map_err(|error| failed(settings, error))?;
        let Some((began_ns, end)) = whole else {
            return Self::begin(file, settings).map_err(|error| failed(settings, error));
        };
        let at_end = file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end)));
        at_end.map_err(|error| failed(settings, error))?;
        let left_bytes = settings.most_bytes.saturating_sub(end);
        let mut file = Self { file, began_ns, left_bytes, filling: Filling::default() };
        file.filling.push(&Record { at_ns: file.now_ns(), event: Event::WorkerBegan });
        Ok(file)
    }

    fn begin(mut file: File, settings: &RecordSettings) -> io::Result<Self> {
        let began_ns = since_1970_ns();
        file.set_len(0)?;
        file.write_all(bytemuck::bytes_of(&FileHeader::new(began_ns)))?;
        let left_bytes = settings.most_bytes.saturating_sub(size_of::<FileHeader>() as u64);
        Ok(Self { file, began_ns, left_bytes, filling: Filling::default() })
    }

    /// Time since the recording began.
    pub fn now_ns(&self) -> u64 {
        since_1970_ns().saturating_sub(self.began_ns)
    }

    /// When it began, ns since 1970.
    pub const fn began_ns(&self) -> u64 {
        self.began_ns
    }

    /// Writes a record, with the block that it fills.
    pub fn write(&mut self, record: &Record) -> io::Result<Written> {
        self.filling.push(record);
        if self.filling.is_full() { self.flush() } else { Ok(Written::Done) }
    }

    /// Closes the block that is being filled.
    pub fn flush(&mut self) -> io::Result<Written> {
        if self.filling.is_empty() {
            return Ok(Written::Done);
        }
        let block = self.filling.close();
        let Some(left) = self.left_bytes.checked_sub(block.len() as u64) else {
            return Ok(Written::Full);
        };
        self.left_bytes = left;
        self.file.write_all(&block)?;
        Ok(Written::Done)
    }
}

fn failed(settings: &RecordSettings, error: io::Error) -> RecordError {
    FileError::of(&settings.file, Access::Write)(error).into()
}

/// Opens a file that is empty, new or a recording. It holds what clients have sent, and is its user's alone.
fn open(path: &Path) -> Result<File, RecordError> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false).mode(0o600);
    let failed = || FileError::of(path, Access::Write);
    let mut file = options.open(path).map_err(failed())?;
    let mut magic = Vec::new();
    let read = (&file).take(size_of_val(&FILE_MAGIC) as u64).read_to_end(&mut magic);
    read.and_then(|_| file.rewind()).map_err(failed())?;
    if magic.is_empty() || magic == FILE_MAGIC.to_le_bytes() {
        Ok(file)
    } else {
        Err(RecordError::NoRecording(path.to_owned()))
    }
}

/// When a recording began, and the end of its last whole block; `None` where not even its header is there. Blocks are
/// not decompressed: clients wait for a worker that begins.
fn whole_part(file: &File) -> io::Result<Option<(u64, u64)>> {
    let recording = match Recording::open(file) {
        Ok(recording) => recording,
        Err(ReadError::Io(error)) => return Err(error),
        Err(_) => return Ok(None),
    };
    let (bytes, mut end) = (file.metadata()?.len(), recording.at());
    let mut header = BlockHeader::zeroed();
    let behind = |end: u64| end + size_of::<BlockHeader>() as u64;
    while behind(end) <= bytes {
        file.read_exact_at(bytemuck::bytes_of_mut(&mut header), end)?;
        match header.packed_bytes() {
            Ok(packed) if behind(end) + packed as u64 <= bytes => end = behind(end) + packed as u64,
            _ => break,
        }
    }
    Ok(Some((recording.began_ns(), end)))
}

fn since_1970_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    // A clock before 1970: all times are zero.
    since.map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}
