//! How an edit comes to the GPU: as a copy.

use std::sync::Arc;

use bytemuck::Pod;
use pairmask_core::Aabb;
use pairmask_core::scene::{Edit, Indices, Sets};
use rayon::iter::{IndexedParallelIterator as _, ParallelIterator as _};
use rayon::slice::ParallelSlice as _;

use crate::execute::gpu::{Gpu, GpuError, Growing, Home, Part};

/// Copies up to so many bytes go to video memory straight, which the CPU stores into at 19 GB/s; the GPU
/// reads larger ones from host memory, where several threads copy faster.
const MAPPED_BYTES: u64 = 1 << 20;
const COPY_BYTES: usize = 512 << 10;

/// Memory for copies: in video memory, or in the host's for large ones.
pub(super) struct Staging {
    mapped: Growing,
    host: Growing,
}

impl Default for Staging {
    fn default() -> Self {
        Self { mapped: Growing::new(Home::MappedVideo), host: Growing::new(Home::Host) }
    }
}

impl Staging {
    /// Bytes copied to where the GPU sees them, with one thread on none of the pool: its work would wait there behind
    /// others' that wait for the GPU that this thread holds. The part is the whole block, so that frames of edits of
    /// other sizes bind the same. `replaced` is set if the block is another.
    pub fn copied(
        &mut self,
        gpu: &Arc<Gpu>,
        values: &[impl Pod],
        threads: usize,
        replaced: &mut bool,
    ) -> Result<Part, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let len = bytes.len() as u64;
        let is_mapped = gpu.limits().mapped_video_memory && len <= MAPPED_BYTES;
        let growing = if is_mapped { &mut self.mapped } else { &mut self.host };
        let Part { block, .. } = growing.part(gpu, len.max(1), replaced)?;
        let most = gpu.limits().storage_binding_bytes;
        if len > most {
            return Err(GpuError::OutOfMemory { bytes: len });
        }
        if threads == 1 || bytes.len() <= 2 * COPY_BYTES {
            block.write(0, bytes);
        } else {
            let chunks = bytes.par_chunks(COPY_BYTES).enumerate();
            chunks.for_each(|(at, chunk)| block.write((at * COPY_BYTES) as u64, chunk));
        }
        Ok(Part::of(&block, 0, block.bytes().min(most)))
    }
}

pub(super) struct Uploaded {
    pub boxes: Part,
    /// Their indices, where they are a list.
    pub indices: Part,
    pub set_count: u32,
    /// The index of the first, where they are a range.
    pub set_first: Option<u32>,
    pub marks: Part,
    pub mark_count: u32,
}

#[derive(Default)]
pub(super) struct Gathered {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
}

#[derive(Clone, Copy)]
pub(super) struct GatheredSets<'a> {
    boxes: &'a [Aabb],
    /// Where they belong, in the order of the boxes; none where that is a range.
    indices: &'a [u32],
    /// The first, where they are a range.
    first: Option<u32>,
}

impl Gathered {
    pub fn allocated_bytes(&self) -> usize {
        self.indices.capacity() * size_of::<u32>() + self.boxes.capacity() * size_of::<Aabb>()
    }

    pub fn sets<'a>(&'a mut self, edit: Edit<'a>) -> GatheredSets<'a> {
        self.indices.clear();
        self.boxes.clear();
        let mut sets = edit.sets().filter(|sets| !sets.boxes.is_empty());
        let (boxes, indices, first): (&[Aabb], &[u32], Option<u32>) =
            match (sets.next(), sets.next()) {
                (None, _) => (&[], &[], None),
                (Some(Sets { indices: Indices::Range { first, .. }, boxes }), None) => {
                    (boxes, &[], Some(*first))
                }
                (Some(Sets { indices: Indices::List(list), boxes }), None) => (boxes, list, None),
                (Some(Sets { indices, boxes }), None) => {
                    indices.for_each(|_, index| self.indices.push(index));
                    (boxes, &self.indices, None)
                }
                (Some(_), Some(_)) => {
                    for Sets { indices, boxes } in edit.sets() {
                        indices.for_each(|_, index| self.indices.push(index));
                        self.boxes.extend_from_slice(boxes);
                    }
                    (&self.boxes, &self.indices, None)
                }
            };
        GatheredSets { boxes, indices, first }
    }
}

#[derive(Default)]
pub(super) struct Upload {
    boxes: Staging,
    indices: Staging,
    marks: Staging,
    pub queries: Staging,
}

impl Upload {
    /// Brings what an edit sets, and its marks. `replaced` is set if a block was.
    pub fn put(
        &mut self,
        gpu: &Arc<Gpu>,
        sets: GatheredSets<'_>,
        marks: &[[u32; 2]],
        threads: usize,
        replaced: &mut bool,
    ) -> Result<Uploaded, GpuError> {
        let GatheredSets { boxes, indices, first } = sets;
        Ok(Uploaded {
            boxes: self.boxes.copied(gpu, boxes, threads, replaced)?,
            indices: self.indices.copied(gpu, indices, threads, replaced)?,
            set_count: boxes.len() as u32,
            set_first: first,
            marks: self.marks.copied(gpu, marks, threads, replaced)?,
            mark_count: marks.len() as u32,
        })
    }
}
