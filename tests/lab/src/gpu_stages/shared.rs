//! Shared memory as the daemon has it: boxes that a client wrote, and the reply for it.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;

use pairmask::Aabb;
use pairmask::engine::{ReplyBuffer, ReserveError};
use pairmaskd::execute::gpu::import::ReadWriteMapping;

/// An anonymous shared segment.
pub(super) struct Segment {
    // Open as long as the mapping, since an import finds the pages through the file.
    _file: File,
    mapping: ReadWriteMapping,
}

impl Segment {
    pub(super) fn new(bytes: usize) -> io::Result<Self> {
        let flags = rustix::fs::MemfdFlags::CLOEXEC;
        let file = File::from(rustix::fs::memfd_create("pairmask-bench", flags)?);
        file.set_len(bytes.max(1).next_multiple_of(4096) as u64)?;
        let mapping = ReadWriteMapping::of_file(&file, 0, bytes)?;
        let mut segment = Self { _file: file, mapping };
        // The first touch must not be in any measurement.
        segment.words_mut().fill(0);
        Ok(segment)
    }

    pub(super) fn address(&self) -> usize {
        self.mapping.pointer().as_ptr() as usize
    }

    pub(super) fn bytes(&self) -> usize {
        self.mapping.bytes()
    }

    pub(super) fn write(&mut self, boxes: &[Aabb]) {
        let words: &[u32] = bytemuck::cast_slice(boxes);
        self.words_mut()[..words.len()].copy_from_slice(words);
    }

    pub(super) fn boxes(&self, n: usize) -> &[Aabb] {
        bytemuck::cast_slice(&self.words()[..n * (size_of::<Aabb>() / 4)])
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
