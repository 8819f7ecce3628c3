//! Which words of a chunk are not zero, as the bits of a u64.
#![allow(unsafe_code)]

use crate::simd::Simd;

/// Words looked at in one step: 256 bytes, four cache lines. Their flags fill one u64, and getting
/// them is straight vector code without a branch. Smaller chunks branch more often.
pub(super) const CHUNK_WORDS: usize = 64;

pub(super) type Chunk = [u32; CHUNK_WORDS];

/// A way to find the non-zero words of a chunk.
pub(super) trait FindWords: Copy {
    /// Bit i is set where word i is not zero.
    fn flags_of(self, chunk: &Chunk) -> u64;
}

/// What every machine of the architecture can do.
#[derive(Clone, Copy)]
pub(super) struct Plain;

impl FindWords for Plain {
    #[inline]
    fn flags_of(self, chunk: &Chunk) -> u64 {
        flags_of(chunk)
    }
}

impl<S: Simd> FindWords for S {
    #[inline(always)]
    fn flags_of(self, chunk: &Chunk) -> u64 {
        let words: &[i32; CHUNK_WORDS] = bytemuck::cast_ref(chunk);
        let mut zero = 0;
        for first in (0..CHUNK_WORDS).step_by(S::LANES) {
            let lanes = self.equal(self.load(&words[first..]), self.splat(0));
            zero |= u64::from(self.bits(lanes)) << first;
        }
        !zero
    }
}

/// Bit i is set where word i is not zero.
#[inline]
fn flags_of(chunk: &Chunk) -> u64 {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: every x86-64 processor has SSE2.
        unsafe { sse2(chunk) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        portable(chunk)
    }
}

/// SSE2: comparisons are all ones or zero, and saturating packs keep them so on the way from words
/// to halves to bytes to one bit each.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "sse2")]
#[inline]
fn sse2(chunk: &Chunk) -> u64 {
    use std::arch::x86_64::{
        __m128i, _mm_cmpeq_epi32, _mm_movemask_epi8, _mm_packs_epi16, _mm_packs_epi32,
        _mm_setzero_si128,
    };
    let quads: [__m128i; CHUNK_WORDS / 4] = bytemuck::cast(*chunk);
    let mut zero = 0;
    for (i, [a, b, c, d]) in quads.as_chunks::<4>().0.iter().enumerate() {
        let is_zero = |quad: &__m128i| _mm_cmpeq_epi32(*quad, _mm_setzero_si128());
        let low = _mm_packs_epi32(is_zero(a), is_zero(b));
        let high = _mm_packs_epi32(is_zero(c), is_zero(d));
        let sixteen = _mm_movemask_epi8(_mm_packs_epi16(low, high)) as u16;
        zero |= u64::from(sixteen) << (16 * i);
    }
    !zero
}

/// Two steps that compile to vector code: words to bytes of 0 or 1, then eight such bytes to eight
/// bits.
#[cfg(any(test, not(target_arch = "x86_64")))]
fn portable(chunk: &Chunk) -> u64 {
    // The product moves byte i to bit 56 + i. No two of its terms meet, so none carries.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let bytes = chunk.map(|word| u8::from(word != 0));
    let eights = bytes.as_chunks::<8>().0;
    (0..).zip(eights).fold(0, |flags, (i, eight)| {
        flags | ((u64::from_le_bytes(*eight).wrapping_mul(GATHER) >> 56) << (8 * i))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_name_the_non_zero_words() {
        let mixed = |seed: u64| seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (seed << 60);
        for (i, pattern) in (0..500).map(mixed).chain([u64::MAX, 1 << 63, 1]).enumerate() {
            let bit = i as u32 % 32;
            let words = std::array::from_fn(|i| ((pattern >> i) as u32 & 1) << bit);
            assert_eq!(flags_of(&words), pattern, "pattern {pattern:#x}, bit {bit}");
            assert_eq!(portable(&words), pattern, "pattern {pattern:#x}, bit {bit}");
        }
    }
}
