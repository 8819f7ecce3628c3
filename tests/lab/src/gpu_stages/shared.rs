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
use pairmaskd::execute::gpu::{
    AllPairs, Gpu, Grid, ImportError, ImportId, ReadWriteMapping, SharedImports, StepTime,
};

use crate::Result;

pub(crate) struct Segment {
    // Open as long as the mapping, since an import finds the pages through the file.
    _file: File,
    mapping: ReadWriteMapping,
    /// Imports of the mapping, one a device; they end before the mapping does.
    imported: Vec<(SharedImports, ImportId)>,
}

impl Segment {
    pub(crate) fn new(bytes: usize) -> io::Result<Self> {
        let flags = rustix::fs::MemfdFlags::CLOEXEC;
        let file = File::from(rustix::fs::memfd_create("pairmask-bench", flags)?);
        file.set_len(bytes.max(1).next_multiple_of(4096) as u64)?;
        let mapping = ReadWriteMapping::of_file(&file, 0, bytes)?;
        let mut segment = Self { _file: file, mapping, imported: Vec::new() };
        // The first touch must not be in any measurement.
        segment.words_mut().fill(0);
        Ok(segment)
    }

    /// Imports the segment, for boxes and replies.
    pub(crate) fn import(
        &mut self,
        gpu: &Arc<Gpu>,
        imports: &SharedImports,
    ) -> Result<(), ImportError> {
        let (address, bytes) = (self.address(), self.bytes());
        // SAFETY: the mapping stays where it is until the segment is dropped, which forgets the
        // import first.
        let id = unsafe { imports.lock().import_replies(gpu, address, bytes) }?;
        self.imported.push((imports.clone(), id));
        Ok(())
    }

    fn address(&self) -> usize {
        self.mapping.pointer().as_ptr() as usize
    }

    pub(super) fn bytes(&self) -> usize {
        self.mapping.bytes()
    }

    pub(crate) fn write(&mut self, objects: &[impl Pod]) {
        let words: &[u32] = bytemuck::cast_slice(objects);
        self.words_mut()[..words.len()].copy_from_slice(words);
    }

    pub(super) fn boxes(&self, n: usize) -> &[Aabb] {
        self.objects(n)
    }

    pub(crate) fn objects<T: Pod>(&self, n: usize) -> &[T] {
        bytemuck::cast_slice(&self.words()[..n * (size_of::<T>() / 4)])
    }

    pub(super) fn words(&self) -> &[u32] {
        let start = self.mapping.pointer().as_ptr().cast();
        // SAFETY: a live mapping of that many bytes, page-aligned; the GPU writes to it only
        // within a frame, when no slice of it is in use.
        unsafe { std::slice::from_raw_parts(start, self.bytes() / 4) }
    }

    fn words_mut(&mut self) -> &mut [u32] {
        // SAFETY: as in `words`, and borrowed mutably.
        unsafe {
            std::slice::from_raw_parts_mut(self.mapping.pointer().as_ptr().cast(), self.bytes() / 4)
        }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        for (imports, id) in self.imported.drain(..) {
            imports.lock().forget(id);
        }
    }
}

/// An engine with its shared memory.
pub(crate) struct Rig<E> {
    pub(super) engine: E,
    encoding: Encoding,
    n: usize,
    pub(crate) boxes: Segment,
    pub(super) reply: Segment,
    /// Whether boxes and reply were imported.
    pub(super) imported: bool,
}

impl<E: Engine> Rig<E> {
    /// An engine, with memory for boxes and a reply, which are imported where `imports` is there and the driver
    /// imports memory.
    pub(super) fn new(
        engine: E,
        gpu: &Arc<Gpu>,
        imports: Option<&SharedImports>,
        boxes: &[Aabb],
        reply_words: u64,
        encoding: Encoding,
    ) -> Result<Self> {
        let mut rig = Self {
            engine,
            encoding,
            n: boxes.len(),
            boxes: Segment::new(size_of_val(boxes))?,
            reply: Segment::new(4 * reply_words as usize)?,
            imported: imports.is_some(),
        };
        for segment in [&mut rig.boxes, &mut rig.reply] {
            let Some(imports) = imports else { break };
            if let Err(error) = segment.import(gpu, imports) {
                log::warn!("staged: {error}");
                rig.imported = false;
            }
        }
        rig.boxes.write(boxes);
        Ok(rig)
    }

    /// A frame of the boxes in shared memory.
    pub(super) fn frame(&mut self) -> Result<CullReport, CullError> {
        let boxes = self.boxes.boxes(self.n);
        let input = CullInput::boxes(boxes).encoding(self.encoding);
        self.engine.cull(&input, &mut self.reply)
    }
}

/// An engine that tells the times of its last frame's steps.
pub trait Stepped: Engine {
    fn step_times(&self) -> &[StepTime];
}

impl Stepped for Grid {
    fn step_times(&self) -> &[StepTime] {
        self.step_times()
    }
}

impl Stepped for AllPairs {
    fn step_times(&self) -> &[StepTime] {
        self.step_times()
    }
}

/// The memory of a frame that is left under way.
pub(super) struct SegmentFrame {
    pub(super) n: usize,
    pub(crate) boxes: Segment,
    pub(super) reply: Segment,
}

// SAFETY: mappings do not move with the values that own them, and no other reference into these
// exists. A reply that was lent and imported is mapped until the segment is dropped, which forgets
// the import; the engine that is timed imports nothing by itself.
unsafe impl FrameMemory for SegmentFrame {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        work(BoxSlice::from(self.boxes.boxes(self.n)).into(), &mut self.reply)
    }
}

impl ReplyBuffer for Segment {
    fn limit_words(&self) -> u64 {
        self.words().len() as u64
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let limit_bytes = self.bytes() as u64;
        self.words_mut()
            .get_mut(..words as usize)
            .ok_or(ReserveError::TooLarge { at_least_bytes: 4 * words, limit_bytes })
    }
}
