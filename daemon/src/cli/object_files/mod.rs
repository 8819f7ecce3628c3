//! Files of boxes or spheres in one of the [`Format`]s, and files of pairs.
//!
//! What a file holds is untrusted: sizes are held to what is there, and lines have a longest length.

mod format;
mod npy;
mod table;
mod write;

pub use self::format::Format;
pub use self::write::{write_objects, write_pairs};

use std::fs::File;
use std::io::{BufReader, IsTerminal, Read};
use std::os::fd::AsFd;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use bytemuck::Pod;
use pairmask_core::{Aabb, Sphere};

use self::npy::{Header, NpyError, Number};
use self::table::TableError;
use crate::file_error::{Access, FileError};

const _: () = assert!(cfg!(target_endian = "little"), "objects are read as they lie in the file");

const STDIN: &str = "-";
/// Characters of a file's own text that an error quotes: enough to find them in it.
const MOST_QUOTED: usize = 40;

/// What a file holds many of: `COLUMNS.len()` numbers each.
pub trait FileObject: Pod + Default {
    const PLURAL: &'static str;
    const COLUMNS: &'static [&'static str];
    /// The object that contains one of f64. `numbers` has as many as there are columns.
    fn outward(numbers: &[f64]) -> Self;
}

impl FileObject for Aabb {
    const PLURAL: &'static str = "boxes";
    const COLUMNS: &'static [&'static str] =
        &["min.x", "min.y", "min.z", "max.x", "max.y", "max.z"];

    fn outward(numbers: &[f64]) -> Self {
        let [min, max] = [0, 3].map(|from| std::array::from_fn(|axis| numbers[from + axis]));
        Self::outward_from_f64(min, max, [0.0; 3])
    }
}

impl FileObject for Sphere {
    const PLURAL: &'static str = "spheres";
    const COLUMNS: &'static [&'static str] = &["x", "y", "z", "radius"];

    fn outward(numbers: &[f64]) -> Self {
        Self::outward_from_f64([numbers[0], numbers[1], numbers[2]], numbers[3])
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ObjectFileError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{}: it is a device without an end: name a file or a pipe of {plural}", path.display())]
    Endless { path: PathBuf, plural: &'static str },
    #[error(
        "{} has {bytes} bytes, which is {} {plural} of {each} bytes and {} bytes more: is it truncated, or no file of \
         {plural} (text has to have a name in .txt or .csv, an array of numpy one in .npy)?",
        path.display(), bytes / each, bytes % each
    )]
    Size { path: PathBuf, bytes: u64, each: u64, plural: &'static str },
    #[error("{}: {source}", path.display())]
    Table { path: PathBuf, source: TableError },
    #[error("{}: {source}", path.display())]
    Npy { path: PathBuf, source: NpyError },
}

#[derive(Debug)]
pub struct ObjectFile<T> {
    path: PathBuf,
    len: usize,
    source: Source<T>,
}

pub type BoxFile = ObjectFile<Aabb>;

#[derive(Debug)]
enum Source<T> {
    /// A regular file from its first object on, read later straight into the objects' memory.
    File(File),
    /// A pipe, read as a whole: its size was known only at its end.
    Bytes(Vec<u8>),
    /// Numbers that were converted.
    Objects(Vec<T>),
}

impl<T: FileObject> ObjectFile<T> {
    /// Opens a file in the format that its name ends with.
    pub fn open(path: &Path) -> Result<Self, ObjectFileError> {
        Self::open_as(path, Format::of(path))
    }

    /// Opens a file, `-` for stdin.
    pub fn open_as(path: &Path, format: Format) -> Result<Self, ObjectFileError> {
        let failed = |source| FileError::of(path, Access::Read)(source);
        let is_stdin = path == Path::new(STDIN);
        let file = if is_stdin {
            std::io::stdin().as_fd().try_clone_to_owned().map(File::from)
        } else {
            File::open(path)
        }
        .map_err(failed)?;
        let source = match format {
            Format::Raw => Self::binary(path, file, is_stdin)?,
            Format::Npy => Self::npy(path, file, is_stdin)?,
            Format::Text | Format::Csv => {
                let objects =
                    table::read(&mut BufReader::new(file), format).map_err(
                        |error| match error {
                            TableError::Read(error) => failed(error).into(),
                            source => ObjectFileError::Table { path: path.to_owned(), source },
                        },
                    )?;
                (objects.len(), Source::Objects(objects))
            }
        };
        let (len, source) = source;
        Ok(Self { path: path.to_owned(), len, source })
    }

    /// Objects as they lie in memory, from where the file is read to its end.
    fn binary(
        path: &Path,
        mut file: File,
        is_stdin: bool,
    ) -> Result<(usize, Source<T>), ObjectFileError> {
        let (path, plural) = (path.to_owned(), T::PLURAL);
        let failed = |source| FileError::of(&path, Access::Read)(source);
        let metadata = file.metadata().map_err(failed)?;
        let (bytes, source) = if metadata.is_file() && !is_stdin {
            let read = std::io::Seek::stream_position(&mut file).map_err(failed)?;
            (metadata.len().saturating_sub(read), Source::File(file))
        } else {
            let mut bytes = Vec::new();
            if metadata.file_type().is_char_device() && !file.is_terminal() {
                // /dev/null has nothing to read; what has something there has it without end.
                (&file).take(1).read_to_end(&mut bytes).map_err(failed)?;
                if !bytes.is_empty() {
                    return Err(ObjectFileError::Endless { path, plural });
                }
            }
            file.read_to_end(&mut bytes).map_err(failed)?;
            (bytes.len() as u64, Source::Bytes(bytes))
        };
        let each = size_of::<T>() as u64;
        if !bytes.is_multiple_of(each) {
            return Err(ObjectFileError::Size { path, bytes, each, plural });
        }
        Ok(((bytes / each) as usize, source))
    }

    fn npy(
        path: &Path,
        mut file: File,
        is_stdin: bool,
    ) -> Result<(usize, Source<T>), ObjectFileError> {
        let wrong = |source| match source {
            NpyError::Read(error) => FileError::of(path, Access::Read)(error).into(),
            source => ObjectFileError::Npy { path: path.to_owned(), source },
        };
        let header = Header::read(&mut file).map_err(wrong)?;
        let rows = header.rows(T::COLUMNS).map_err(wrong)?;
        match header.number {
            Number::F32 => {
                let (len, source) = Self::binary(path, file, is_stdin)?;
                if len as u64 != rows {
                    return Err(wrong(NpyError::Rows { said: rows, found: len as u64 }));
                }
                Ok((len, source))
            }
            Number::F64 => {
                let objects = npy::read_f64(&mut BufReader::new(file), rows).map_err(wrong)?;
                Ok((objects.len(), Source::Objects(objects)))
            }
        }
    }

    pub const fn count(&self) -> usize {
        self.len
    }

    /// Reads the objects into `objects`, which holds [`ObjectFile::count`] of them.
    pub fn read_into(self, objects: &mut [T]) -> Result<(), FileError> {
        let Self { path, source, .. } = self;
        let memory: &mut [u8] = bytemuck::cast_slice_mut(objects);
        match source {
            Source::File(mut file) => file.read_exact(memory),
            Source::Bytes(bytes) => bytes.as_slice().read_exact(memory),
            Source::Objects(read) => bytemuck::cast_slice(&read).read_exact(memory),
        }
        .map_err(FileError::of(path, Access::Read))
    }

    pub fn read(self) -> Result<Vec<T>, FileError> {
        let mut objects = vec![T::default(); self.count()];
        self.read_into(&mut objects)?;
        Ok(objects)
    }
}

/// The beginning of a file's own text, for an error.
fn quoted(text: &str) -> String {
    let shown = text.trim().chars().take(MOST_QUOTED);
    shown.map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests;
