//! Memory of frames that are left to a GPU: on the heap, and shared so that the GPU writes to it.
#![allow(unsafe_code)]

use std::fs::File;
use std::sync::Arc;

use pairmask_core::engine::{HeapReply, ReplyBuffer, ReserveError};
use pairmask_core::objects::Objects;
use pairmask_core::{Aabb, Precision};
use pairmaskd::execute::FrameMemory;
use pairmaskd::execute::gpu::{Gpu, ImportId, ReadWriteMapping, SharedImports};

use crate::narrow::NarrowMemory;

/// Boxes and a reply, with a token whose [`Arc::strong_count`] shows whether they still exist.
pub struct TestFrame<R> {
    pub boxes: NarrowMemory,
    pub reply: R,
    /// Dropped with the memory.
    pub token: Arc<()>,
}

impl TestFrame<HeapReply> {
    pub fn on_heap(precision: &Precision, boxes: &[Aabb]) -> Self {
        let boxes = NarrowMemory::write(precision, boxes);
        Self { boxes, reply: HeapReply::new(), token: Arc::default() }
    }
}

// SAFETY: the boxes, and the words of either reply, are in memory of their own that does not move with
// its owner, to which no other reference exists. Heap memory is not shared; the mapping of a shared
// reply stays until the reply is dropped, which ends its import before. Tests give the latter to engines
// that import nothing by themselves.
unsafe impl FrameMemory for TestFrame<HeapReply> {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        work(self.boxes.boxes().into(), &mut self.reply)
    }
}

// SAFETY: as above.
unsafe impl FrameMemory for TestFrame<SharedReply> {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        work(self.boxes.boxes().into(), &mut self.reply)
    }
}

/// A reply in shared memory that a GPU has imported.
pub struct SharedReply {
    imports: SharedImports,
    import: ImportId,
    mapping: ReadWriteMapping,
    /// Where in the memory replies begin, in words.
    pub first: usize,
}

impl SharedReply {
    pub fn new(gpu: &Arc<Gpu>, imports: &SharedImports, pages: usize) -> (Self, Watcher) {
        let flags = rustix::fs::MemfdFlags::CLOEXEC;
        let file = rustix::fs::memfd_create("pairmask-test-reply", flags).expect("a memfd");
        let (file, bytes) = (File::from(file), pages * 4096);
        file.set_len(bytes as u64).expect("room");
        let map = || ReadWriteMapping::of_file(&file, 0, bytes).expect("maps");
        let mapping = map();
        let address = mapping.pointer().as_ptr() as usize;
        // SAFETY: the mapping stays where it is until the reply is dropped, which drops the import.
        let import = unsafe { imports.lock().import_replies(gpu, address, bytes) };
        let import = import.unwrap_or_else(|error| panic!("shared memory imports: {error}"));
        (Self { imports: imports.clone(), import, mapping, first: 0 }, Watcher(map()))
    }

    pub fn words(&self) -> &[u32] {
        let first = self.mapping.pointer().as_ptr().cast();
        // SAFETY: a live mapping of whole pages; the GPU writes to it within a frame alone, which
        // owns this reply.
        let all = unsafe { std::slice::from_raw_parts(first, self.mapping.bytes() / 4) };
        &all[self.first..]
    }
}

impl Drop for SharedReply {
    fn drop(&mut self) {
        self.imports.lock().discard(self.import);
    }
}

impl ReplyBuffer for SharedReply {
    fn limit_words(&self) -> u64 {
        (self.mapping.bytes() / 4 - self.first) as u64
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let limit_bytes = 4 * self.limit_words();
        let first = self.mapping.pointer().as_ptr().cast();
        // SAFETY: as in `words`, and borrowed mutably.
        let all = unsafe { std::slice::from_raw_parts_mut(first, self.mapping.bytes() / 4) };
        let refused = ReserveError::TooLarge { at_least_bytes: 4 * words, limit_bytes };
        all[self.first..].get_mut(..words as usize).ok_or(refused)
    }
}

pub struct Watcher(ReadWriteMapping);

impl Watcher {
    pub fn fill(&self, word: u32) {
        for slot in 0..self.0.bytes() / 4 {
            // SAFETY: within a live mapping, aligned.
            unsafe { self.word(slot).write_volatile(word) };
        }
    }

    pub fn is_all(&self, word: u32) -> bool {
        // SAFETY: as in `fill`.
        (0..self.0.bytes() / 4).all(|slot| unsafe { self.word(slot).read_volatile() } == word)
    }

    fn word(&self, slot: usize) -> *mut u32 {
        let first: *mut u32 = self.0.pointer().as_ptr().cast();
        first.wrapping_add(slot)
    }
}
