//! A reply buffer in the process's own memory: what the in-process session and the tests use.

use std::sync::Arc;

use crate::aligned::{AlignedBuffer, NoMemory};
use crate::cancel::Wanted;
use crate::engine::{RecentNeed, ReplyBuffer, ReserveError};

const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// Memory for one mask, kept from frame to frame: a steady scene allocates nothing. What much larger
/// masks left behind is given back after some dozens of smaller ones.
pub struct HeapReply {
    words: AlignedBuffer<u32>,
    limit_bytes: u64,
    need: RecentNeed,
    asker: Option<Arc<dyn Wanted>>,
}

impl Default for HeapReply {
    fn default() -> Self {
        Self::new()
    }
}

impl HeapReply {
    /// An empty buffer that grows as far as memory goes.
    pub fn new() -> Self {
        Self::with_limit_bytes(u64::MAX)
    }

    /// An empty buffer that refuses a mask of more than `limit_bytes`.
    pub fn with_limit_bytes(limit_bytes: u64) -> Self {
        Self {
            words: AlignedBuffer::default(),
            limit_bytes,
            need: RecentNeed::default(),
            asker: None,
        }
    }

    /// Refuses masks of more than `limit_bytes` from now on.
    pub fn set_limit_bytes(&mut self, limit_bytes: u64) {
        self.limit_bytes = limit_bytes;
    }

    /// Who says whether later masks are still wanted; `None` where they are in any case.
    pub fn set_asker(&mut self, asker: Option<Arc<dyn Wanted>>) {
        self.asker = asker;
    }

    /// Bytes that are allocated, which may be more than the last mask took.
    pub fn allocated_bytes(&self) -> usize {
        self.words.allocated_bytes()
    }

    /// The words of the last [`ReplyBuffer::reserve`]: the mask, after a successful cull.
    pub fn words(&self) -> &[u32] {
        self.words.as_slice()
    }

    /// Fills all memory held so far with one word. Tests do so before a frame, to see that an
    /// engine leaves no word of its mask unwritten.
    pub fn fill(&mut self, word: u32) {
        let all = self.words.allocated_bytes() / size_of::<u32>();
        self.words.resize(all);
        self.words.as_mut_slice().fill(word);
    }
}

impl ReplyBuffer for HeapReply {
    fn limit_words(&self) -> u64 {
        if self.limit_bytes == u64::MAX { u64::MAX } else { self.limit_bytes / WORD_BYTES }
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let needed_bytes = words.saturating_mul(WORD_BYTES);
        if needed_bytes > self.limit_bytes {
            return Err(ReserveError::TooLarge {
                at_least_bytes: needed_bytes,
                limit_bytes: self.limit_bytes,
            });
        }
        let out_of_memory = ReserveError::OutOfMemory { needed_bytes };
        let len = usize::try_from(words).map_err(|_| out_of_memory)?;
        if self.need.note(len.saturating_mul(size_of::<u32>()), || self.words.allocated_bytes()) {
            self.words = AlignedBuffer::default();
        }
        self.words.try_resize(len).map_err(|NoMemory(_)| out_of_memory)?;
        Ok(self.words.as_mut_slice())
    }

    fn asker(&self) -> Option<Arc<dyn Wanted>> {
        self.asker.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_kept_when_it_suffices() {
        let mut reply = HeapReply::new();
        let first = reply.reserve(1000).expect("4 kB").as_ptr();
        assert_eq!(first.addr() % 64, 0);
        assert_eq!(reply.reserve(10).expect("less").as_ptr(), first);
        assert_eq!(reply.words().len(), 10);
        reply.fill(0xdead_beef);
        assert!(reply.reserve(1000).expect("again").iter().all(|&w| w == 0xdead_beef));
    }

    #[test]
    fn memory_that_smaller_masks_do_not_need_is_given_back() {
        let mut reply = HeapReply::new();
        reply.reserve(1 << 20).expect("4 MiB");
        for _ in 0..64 {
            assert_eq!(reply.words.allocated_bytes(), 4 << 20, "kept for a window of frames");
            reply.reserve(100).expect("less");
        }
        for _ in 0..64 {
            reply.reserve(100).expect("less");
        }
        assert!(reply.words.allocated_bytes() < 1 << 10);
        assert!(reply.reserve(1 << 20).is_ok_and(|words| words.len() == 1 << 20));
    }

    #[test]
    fn a_limit_is_a_typed_error() {
        let mut reply = HeapReply::with_limit_bytes(64);
        assert!(reply.reserve(16).is_ok());
        assert_eq!(
            reply.reserve(17).err(),
            Some(ReserveError::TooLarge { at_least_bytes: 68, limit_bytes: 64 })
        );
        let impossible = HeapReply::new().reserve(u64::MAX / 4).err();
        assert!(matches!(impossible, Some(ReserveError::OutOfMemory { .. })));
    }
}
