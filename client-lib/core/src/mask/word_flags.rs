//! Which words of a chunk are not zero, as the bits of a u64.

use crate::simd::{Simd, per_isa};

/// Words looked at in one step: 256 bytes, four cache lines. Their flags fill one u64, and getting
/// them is straight vector code without a branch. Smaller chunks branch more often.
pub(super) const CHUNK_WORDS: usize = 64;

pub(super) type Chunk = [u32; CHUNK_WORDS];

/// Bit i is set where word i is not zero.
#[inline(always)]
pub(super) fn flags_by<S: Simd>(simd: S, chunk: &Chunk) -> u64 {
    let words: &[i32; CHUNK_WORDS] = bytemuck::cast_ref(chunk);
    let mut zero = 0;
    for first in (0..CHUNK_WORDS).step_by(S::LANES) {
        let lanes = simd.equal(simd.load(&words[first..]), simd.splat(0));
        zero |= u64::from(simd.bits(lanes)) << first;
    }
    !zero
}

per_isa! {
    /// The same for callers that are not compiled for an instruction set.
    pub(super) fn flags_of<simd: S>(chunk: &Chunk) -> u64 {
        flags_by(simd, chunk)
    }
}
