//! Files of boxes: little-endian f32, `min.x min.y min.z max.x max.y max.z`, 24 bytes a box,
//! nothing before, between or after them.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use pairmask::Aabb;
use pairmask::aabb::AABB_BYTES;

const _: () = assert!(cfg!(target_endian = "little"), "boxes are read as they lie in the file");

/// Name that stands for stdin.
const STDIN: &str = "-";

/// Why a file of boxes cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RawBoxesError {
    /// The system said no.
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    /// Its size is not a multiple of 24.
    #[error(
        "{} has {bytes} bytes, which is {} boxes of {AABB_BYTES} bytes and {} bytes more: is it truncated, or no file of boxes?",
        path.display(), bytes / AABB_BYTES as u64, bytes % AABB_BYTES as u64
    )]
    OddSize { path: PathBuf, bytes: u64 },
}

/// A file of boxes whose number is known, not yet read where that can wait.
#[derive(Debug)]
pub struct RawBoxes {
    path: PathBuf,
    boxes: usize,
    source: Source,
}

#[derive(Debug)]
enum Source {
    /// A regular file: read straight to where the boxes are wanted.
    File(File),
    /// A pipe: its size was only known at its end.
    Bytes(Vec<u8>),
}

impl RawBoxes {
    /// Opens a file, or stdin for `-`.
    ///
    /// # Errors
    /// [`RawBoxesError`].
    pub fn open(path: &Path) -> Result<Self, RawBoxesError> {
        let failed = |source| RawBoxesError::Io { path: path.to_owned(), source };
        let all_of = |mut stream: Box<dyn Read>| {
            let mut bytes = Vec::new();
            stream.read_to_end(&mut bytes).map(|_| bytes).map_err(failed)
        };
        let (bytes, source) = if path == Path::new(STDIN) {
            let bytes = all_of(Box::new(std::io::stdin().lock()))?;
            (bytes.len() as u64, Source::Bytes(bytes))
        } else {
            let file = File::open(path).map_err(failed)?;
            let metadata = file.metadata().map_err(failed)?;
            if metadata.is_file() {
                (metadata.len(), Source::File(file))
            } else {
                let bytes = all_of(Box::new(file))?;
                (bytes.len() as u64, Source::Bytes(bytes))
            }
        };
        if !bytes.is_multiple_of(AABB_BYTES as u64) {
            return Err(RawBoxesError::OddSize { path: path.to_owned(), bytes });
        }
        Ok(Self { path: path.to_owned(), boxes: bytes as usize / AABB_BYTES, source })
    }

    /// Number of boxes.
    pub const fn len(&self) -> usize {
        self.boxes
    }

    /// Reads the boxes to where they are wanted: `boxes` has room for [`RawBoxes::len`] of them.
    ///
    /// # Errors
    /// [`RawBoxesError::Io`], also where the file has become shorter.
    pub fn read_into(self, boxes: &mut [Aabb]) -> Result<(), RawBoxesError> {
        let Self { path, source, .. } = self;
        let memory: &mut [u8] = bytemuck::cast_slice_mut(boxes);
        match source {
            Source::File(mut file) => file.read_exact(memory),
            Source::Bytes(bytes) => bytes.as_slice().read_exact(memory),
        }
        .map_err(|source| RawBoxesError::Io { path, source })
    }

    /// Reads the boxes into memory of their own.
    ///
    /// # Errors
    /// As [`RawBoxes::read_into`].
    pub fn read(self) -> Result<Vec<Aabb>, RawBoxesError> {
        let mut boxes = vec![Aabb::default(); self.len()];
        self.read_into(&mut boxes)?;
        Ok(boxes)
    }
}
