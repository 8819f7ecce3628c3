//! Shared memory as the daemon has it: boxes that a client wrote, and the reply for it; and engines with theirs.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::sync::Arc;

use bytemuck::Pod;
use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, ReplyBuffer, ReserveError};
use pairmask_core::objects::Objects;
use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, Encoding};
use pairmaskd::execute::FrameMemory;
use pairmaskd::execute::gpu::{Gpu, ImportError, ImportId, ReadWriteMapping, SharedImports};

use crate::Result;

pub(crate) struct Segment {
    // Open as long as the mapping, since an import finds the pages through the file.
    _file: File,
    mapping: ReadWriteMapping,
    /// The mapping's import, which ends before it does.
    imported: Option<(SharedImports, ImportId)>,
}

impl Segment {
    fn new(bytes: usize) -> io::Result<Self> {
        let flags = rustix::fs::MemfdFlags::CLOEXEC;
        let file = File::from(rustix::fs::memfd_create("pairmask-bench", flags)?);
        file.set_len(bytes.max(1).next_multiple_of(4096) as u64)?;
        let mapping = ReadWriteMapping::of_file(&file, 0, bytes)?;
        let mut segment = Self { _file: file, mapping, imported: None };
        // The first touch must not be in any measurement.
        segment.words_mut().fill(0);
        Ok(segment)
    }

    fn import(&mut self, gpu: &Arc<Gpu>, imports: &SharedImports) -> Result<(), ImportError> {
        let (address, bytes) = (self.mapping.pointer().as_ptr() as usize, self.mapping.bytes());
        // SAFETY: the mapping stays where it is until the segment is dropped, which drops the
        // import first.
        let id = unsafe { imports.lock().import_replies(gpu, address, bytes) }?;
        self.imported = Some((imports.clone(), id));
        Ok(())
    }

    pub(crate) fn write(&mut self, objects: &[impl Pod]) {
        let words: &[u32] = bytemuck::cast_slice(objects);
        self.words_mut()[..words.len()].copy_from_slice(words);
    }

    pub(crate) fn objects<T: Pod>(&self, n: usize) -> &[T] {
        bytemuck::cast_slice(&self.words()[..n * (size_of::<T>() / 4)])
    }

    pub(crate) fn words(&self) -> &[u32] {
        let (start, bytes) = (self.mapping.pointer().as_ptr().cast(), self.mapping.bytes());
        // SAFETY: a live mapping of that many bytes, page-aligned; the GPU writes to it only
        // within a frame, when no slice of it is in use.
        unsafe { std::slice::from_raw_parts(start, bytes / 4) }
    }

    fn words_mut(&mut self) -> &mut [u32] {
        let (start, bytes) = (self.mapping.pointer().as_ptr().cast(), self.mapping.bytes());
        // SAFETY: as in `words`, and borrowed mutably.
        unsafe { std::slice::from_raw_parts_mut(start, bytes / 4) }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        if let Some((imports, id)) = self.imported.take() {
            imports.lock().discard(id);
        }
    }
}

pub(crate) struct FrameSegments {
    n: usize,
    pub(crate) boxes: Segment,
    pub(crate) reply: Segment,
    pub(crate) imported: bool,
}

impl FrameSegments {
    /// Memory that holds these objects, imported where the driver imports memory.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        imports: &SharedImports,
        objects: &[impl Pod],
        reply_words: u64,
    ) -> Result<Self> {
        let mut memory = Self {
            n: objects.len(),
            boxes: Segment::new(size_of_val(objects))?,
            reply: Segment::new(4 * reply_words as usize)?,
            imported: true,
        };
        for segment in [&mut memory.boxes, &mut memory.reply] {
            if let Err(error) = segment.import(gpu, imports) {
                log::warn!("staged: {error}");
                memory.imported = false;
            }
        }
        memory.boxes.write(objects);
        Ok(memory)
    }
}

// SAFETY: mappings do not move with the values that own them, and no other reference into these
// exists. A reply that was lent and imported is mapped until the segment is dropped, which drops
// the import; the engine that is timed imports nothing by itself.
unsafe impl FrameMemory for FrameSegments {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        work(BoxSlice::from(self.boxes.objects::<Aabb>(self.n)).into(), &mut self.reply)
    }
}

pub(crate) struct Rig<E> {
    pub(crate) engine: E,
    pub(crate) memory: FrameSegments,
}

impl<E: Engine> Rig<E> {
    pub(crate) fn frame(&mut self) -> Result<CullReport, CullError> {
        let FrameSegments { n, boxes, reply, .. } = &mut self.memory;
        self.engine.cull(&CullInput::boxes(boxes.objects(*n)).encoding(Encoding::Sparse), reply)
    }
}

impl ReplyBuffer for Segment {
    fn limit_words(&self) -> u64 {
        self.words().len() as u64
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let limit_bytes = self.mapping.bytes() as u64;
        self.words_mut()
            .get_mut(..words as usize)
            .ok_or(ReserveError::TooLarge { at_least_bytes: 4 * words, limit_bytes })
    }
}
