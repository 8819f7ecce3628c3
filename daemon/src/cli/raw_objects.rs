//! Files of boxes or spheres: little-endian f32, `min.x min.y min.z max.x max.y max.z`, 24 bytes a
//! box, or `x y z radius`, 16 bytes a sphere, nothing before, between or after them.

use std::fs::File;
use std::io::{IsTerminal, Read};
use std::marker::PhantomData;
use std::os::fd::AsFd;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use bytemuck::Pod;
use pairmask_core::{Aabb, Sphere};

use super::program::Result;
use crate::file_error::{Access, FileError};

const _: () = assert!(cfg!(target_endian = "little"), "objects are read as they lie in the file");

const STDIN: &str = "-";

pub trait RawObject: Pod + Default {
    const PLURAL: &'static str;
}

impl RawObject for Aabb {
    const PLURAL: &'static str = "boxes";
}

impl RawObject for Sphere {
    const PLURAL: &'static str = "spheres";
}

#[derive(Debug)]
pub struct RawObjects<T> {
    path: PathBuf,
    len: usize,
    source: Source,
    objects: PhantomData<T>,
}

pub type RawBoxes = RawObjects<Aabb>;

#[derive(Debug)]
enum Source {
    /// A regular file, read later straight into the objects' memory.
    File(File),
    /// A pipe, read as a whole: its size was known only at its end.
    Bytes(Vec<u8>),
}

impl<T: RawObject> RawObjects<T> {
    pub fn open(path: &Path) -> Result<Self> {
        let failed = |source| FileError::of(path, Access::Read)(source);
        let is_stdin = path == Path::new(STDIN);
        let mut file = if is_stdin {
            std::io::stdin().as_fd().try_clone_to_owned().map(File::from)
        } else {
            File::open(path)
        }
        .map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        let (bytes, source) = if metadata.is_file() && !is_stdin {
            (metadata.len(), Source::File(file))
        } else {
            let mut bytes = Vec::new();
            if metadata.file_type().is_char_device() && !file.is_terminal() {
                // /dev/null has nothing to read; what has something there has it without end.
                (&file).take(1).read_to_end(&mut bytes).map_err(failed)?;
                if !bytes.is_empty() {
                    let (name, plural) = (path.display(), T::PLURAL);
                    let what = "it is a device without an end: name a file or a pipe of";
                    return Err(format!("{name}: {what} {plural}").into());
                }
            }
            file.read_to_end(&mut bytes).map_err(failed)?;
            (bytes.len() as u64, Source::Bytes(bytes))
        };
        let (each, plural) = (size_of::<T>() as u64, T::PLURAL);
        if !bytes.is_multiple_of(each) {
            let (name, count, more) = (path.display(), bytes / each, bytes % each);
            return Err(format!(
                "{name} has {bytes} bytes, which is {count} {plural} of {each} bytes and {more} bytes more: is it truncated, or no file of {plural}?"
            )
            .into());
        }
        let (path, len) = (path.to_owned(), (bytes / each) as usize);
        Ok(Self { path, len, source, objects: PhantomData })
    }

    pub const fn count(&self) -> usize {
        self.len
    }

    /// Reads the objects into `objects`, which holds [`RawObjects::count`] of them.
    pub fn read_into(self, objects: &mut [T]) -> Result {
        let Self { path, source, .. } = self;
        let memory: &mut [u8] = bytemuck::cast_slice_mut(objects);
        match source {
            Source::File(mut file) => file.read_exact(memory),
            Source::Bytes(bytes) => bytes.as_slice().read_exact(memory),
        }
        .map_err(FileError::of(path, Access::Read))?;
        Ok(())
    }

    pub fn read(self) -> Result<Vec<T>> {
        let mut objects = vec![T::default(); self.count()];
        self.read_into(&mut objects)?;
        Ok(objects)
    }
}
