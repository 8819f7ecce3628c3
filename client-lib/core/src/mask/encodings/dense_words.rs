//! The scan of a dense mask: nearly all words are zero, so most of the work is to skip them.

use std::ops::Range;

use crate::isa::AvailableIsa;
use crate::mask::word_flags::{CHUNK_WORDS, Chunk, flags_of};

/// The non-zero words of a range of a dense mask, each with its number in the mask.
#[derive(Clone)]
pub(in crate::mask) struct DenseWords<'a> {
    /// The chunk in hand, of [`CHUNK_WORDS`] or, at the end of the range, fewer.
    chunk: &'a [u32],
    /// Number of the chunk's first word.
    chunk_start: usize,
    /// Bit i: word i of the chunk is not zero and was not yet given out.
    flags: u64,
    /// The words behind the chunk.
    rest: &'a [u32],
    /// Number of the last word of the mask.
    last: usize,
    /// Bits of that word that may be set.
    last_mask: u32,
    isa: AvailableIsa,
}

impl<'a> DenseWords<'a> {
    /// Words `range` of a mask; none where the range leaves the mask.
    pub fn new(mask: &'a [u32], range: Range<usize>, last_mask: u32, isa: AvailableIsa) -> Self {
        let chunk_start = range.start;
        let rest = mask.get(range).unwrap_or(&[]);
        let last = mask.len().saturating_sub(1);
        Self { chunk: &[], chunk_start, flags: 0, rest, last, last_mask, isa }
    }

    pub const fn isa(&self) -> AvailableIsa {
        self.isa
    }

    /// Takes the next chunk with a non-zero word in hand. False at the end.
    #[inline(always)]
    fn next_chunk(&mut self, flags_of: impl Fn(&Chunk) -> u64) -> bool {
        let mut passed = self.chunk.len();
        while let Some((chunk, rest)) = self.rest.split_first_chunk::<CHUNK_WORDS>() {
            self.rest = rest;
            let flags = flags_of(chunk);
            if flags != 0 {
                self.chunk = chunk;
                self.chunk_start += passed;
                self.flags = flags;
                return true;
            }
            passed += CHUNK_WORDS;
        }
        self.chunk_start += passed;
        self.chunk = self.rest;
        self.rest = &[];
        self.flags =
            (0..).zip(self.chunk).fold(0, |flags, (i, word)| flags | u64::from(*word != 0) << i);
        self.flags != 0
    }

    /// The next non-zero word, with a way to find those of a chunk.
    #[inline(always)]
    pub fn next_by(&mut self, flags_of: impl Fn(&Chunk) -> u64) -> Option<(usize, u32)> {
        loop {
            while self.flags != 0 {
                let (number, bits) = self.take();
                if bits != 0 {
                    return Some((number, bits));
                }
            }
            if !self.next_chunk(&flags_of) {
                return None;
            }
        }
    }

    /// Takes one flagged word of the chunk. Its bits may be zero if it is the last of the mask.
    #[inline(always)]
    fn take(&mut self) -> (usize, u32) {
        let i = self.flags.trailing_zeros() as usize;
        self.flags &= self.flags.wrapping_sub(1);
        let number = self.chunk_start + i;
        let bits = self.chunk.get(i).copied().unwrap_or(0);
        (number, if number == self.last { bits & self.last_mask } else { bits })
    }
}

impl Iterator for DenseWords<'_> {
    type Item = (usize, u32);

    #[inline]
    fn next(&mut self) -> Option<(usize, u32)> {
        let isa = self.isa;
        self.next_by(|chunk| flags_of(chunk, isa))
    }
}
