//! The scan of a dense mask with AVX2: a test of 8 words answers in 8 bits.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    _mm256_castsi256_ps, _mm256_cmpeq_epi32, _mm256_loadu_si256, _mm256_movemask_ps,
    _mm256_setzero_si256,
};

use super::DensePairs;
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::PairWriter;
use crate::mask::word_flags::{CHUNK_WORDS, Chunk};

/// [`DensePairs::write_with`] with AVX2.
#[inline]
pub(super) fn write(
    pairs: &mut DensePairs<'_>,
    writer: &mut PairWriter,
    isa: AvailableIsa,
) -> bool {
    assert_eq!(isa.get(), Isa::Avx2, "kernel and instruction set belong together");
    // SAFETY: `isa` is only made where the machine has these features.
    unsafe { run(pairs, writer) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn run(pairs: &mut DensePairs<'_>, writer: &mut PairWriter) -> bool {
    pairs.write_with(writer, |chunk| flags_of(chunk))
}

/// Bit i is set where word i is not zero.
#[target_feature(enable = "avx2")]
#[inline]
fn flags_of(chunk: &Chunk) -> u64 {
    let eights = chunk.as_chunks::<{ CHUNK_WORDS / 8 }>().0;
    let zero = (0..).zip(eights).fold(0, |zero, (i, eight)| {
        // SAFETY: the array holds the 8 words of a register.
        let words = unsafe { _mm256_loadu_si256(eight.as_ptr().cast()) };
        let none = _mm256_cmpeq_epi32(words, _mm256_setzero_si256());
        let none = _mm256_movemask_ps(_mm256_castsi256_ps(none)) as u8;
        zero | u64::from(none) << (8 * i)
    });
    !zero
}
