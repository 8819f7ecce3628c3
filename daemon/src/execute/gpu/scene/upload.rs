//! How an edit comes to the GPU: boxes are read where they lie, if that memory is imported, else copied;
//! indices and marks are copied, since they were checked.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::scene::{Edit, Indices, Sets};
use rayon::iter::{IndexedParallelIterator as _, ParallelIterator as _};
use rayon::slice::ParallelSlice as _;

use crate::execute::gpu::{Access, Gpu, GpuError, Growing, Home, Part, SharedImports};

/// Boxes up to this many bytes are stored by the CPU even where the GPU could read them across the link.
const STORED_FIRST_BYTES: u64 = 32 << 10;
/// Copies up to so many bytes go to video memory straight, which the CPU stores into at 19 GB/s; the GPU
/// reads larger ones from host memory, where several threads copy faster.
const MAPPED_BYTES: u64 = 1 << 20;
/// Bytes that a thread copies at least.
const COPY_BYTES: usize = 512 << 10;

/// Memory for copies: in video memory, or in the host's for large ones.
struct Staging {
    mapped: Growing,
    host: Growing,
}

impl Staging {
    const fn new() -> Self {
        Self { mapped: Growing::new(Home::MappedVideo), host: Growing::new(Home::Host) }
    }

    fn at_least(
        &mut self,
        gpu: &Arc<Gpu>,
        bytes: u64,
        replaced: &mut bool,
    ) -> Result<Part, GpuError> {
        let is_mapped = gpu.limits().mapped_video_memory && bytes <= MAPPED_BYTES;
        let growing = if is_mapped { &mut self.mapped } else { &mut self.host };
        growing.part(gpu, bytes.max(1), replaced)
    }
}

pub(super) struct Uploaded {
    /// Boxes that are set.
    pub boxes: Part,
    /// Their indices, where they are a list.
    pub indices: Part,
    pub set_count: u32,
    /// The index of the first, where they are a range.
    pub set_first: Option<u32>,
    /// Boxes that are removed or flagged.
    pub marks: Part,
    pub mark_count: u32,
}

/// Memory for the sets of an edit where they do not lie together. Kept from edit to edit.
#[derive(Default)]
pub(super) struct Gathered {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
}

/// All boxes that an edit sets, together.
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

pub(super) struct Upload {
    imports: SharedImports,
    boxes: Staging,
    indices: Staging,
    marks: Staging,
    queries: Staging,
}

impl Upload {
    pub fn new(imports: SharedImports) -> Self {
        Self {
            imports,
            boxes: Staging::new(),
            indices: Staging::new(),
            marks: Staging::new(),
            queries: Staging::new(),
        }
    }

    /// Brings what an edit sets, and its marks. `replaced` is set if a block was.
    pub fn place(
        &mut self,
        gpu: &Arc<Gpu>,
        sets: GatheredSets<'_>,
        marks: &[[u32; 2]],
        threads: usize,
        replaced: &mut bool,
    ) -> Result<Uploaded, GpuError> {
        let GatheredSets { boxes, indices, first } = sets;
        let (indices, mark_bytes) = (bytemuck::cast_slice(indices), bytemuck::cast_slice(marks));
        Ok(Uploaded {
            boxes: place_boxes(gpu, &self.imports, &mut self.boxes, boxes, threads, replaced)?,
            indices: copied(gpu, &mut self.indices, indices, threads, replaced)?,
            set_count: boxes.len() as u32,
            set_first: first,
            marks: copied(gpu, &mut self.marks, mark_bytes, threads, replaced)?,
            mark_count: marks.len() as u32,
        })
    }

    /// Brings queries. `replaced` is set if a block was.
    pub fn place_queries(
        &mut self,
        gpu: &Arc<Gpu>,
        queries: &[Aabb],
        threads: usize,
        replaced: &mut bool,
    ) -> Result<Part, GpuError> {
        place_boxes(gpu, &self.imports, &mut self.queries, queries, threads, replaced)
    }
}

fn place_boxes(
    gpu: &Arc<Gpu>,
    imports: &SharedImports,
    staging: &mut Staging,
    boxes: &[Aabb],
    threads: usize,
    replaced: &mut bool,
) -> Result<Part, GpuError> {
    let bytes = size_of_val(boxes) as u64;
    if bytes > STORED_FIRST_BYTES
        && let Some(part) = imports.part(gpu, boxes.as_ptr() as usize, bytes, Access::Read)
    {
        return Ok(part);
    }
    copied(gpu, staging, bytemuck::cast_slice(boxes), threads, replaced)
}

/// Bytes copied to where the GPU sees them, with one thread on none of the pool: its work would wait there behind
/// others' that wait for the GPU that this thread holds. The part is the whole block, so that frames of edits of
/// other sizes bind the same.
fn copied(
    gpu: &Arc<Gpu>,
    staging: &mut Staging,
    bytes: &[u8],
    threads: usize,
    replaced: &mut bool,
) -> Result<Part, GpuError> {
    let Part { block, .. } = staging.at_least(gpu, bytes.len() as u64, replaced)?;
    let most = gpu.limits().storage_binding_bytes;
    if bytes.len() as u64 > most {
        return Err(GpuError::OutOfMemory { bytes: bytes.len() as u64 });
    }
    if threads == 1 || bytes.len() <= 2 * COPY_BYTES {
        block.write(0, bytes);
    } else {
        let chunks = bytes.par_chunks(COPY_BYTES).enumerate();
        chunks.for_each(|(at, chunk)| block.write((at * COPY_BYTES) as u64, chunk));
    }
    Ok(Part::of(&block, 0, block.bytes().min(most)))
}
