//! The scan of a dense mask with AVX-512: a test of 16 words answers in 16 bits, and numbers turn
//! into f64 and back in one instruction each.
#![allow(unsafe_code)]

use std::arch::x86_64::{_mm512_loadu_si512, _mm512_test_epi32_mask};

use super::DensePairs;
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::PairWriter;
use crate::mask::word_flags::{CHUNK_WORDS, Chunk};

/// [`DensePairs::write_with`] with AVX-512.
#[inline]
pub(super) fn write(
    pairs: &mut DensePairs<'_>,
    writer: &mut PairWriter,
    isa: AvailableIsa,
) -> bool {
    assert_eq!(isa.get(), Isa::Avx512, "kernel and instruction set belong together");
    // SAFETY: `isa` is only made where the machine has these features.
    unsafe { run(pairs, writer) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn run(pairs: &mut DensePairs<'_>, writer: &mut PairWriter) -> bool {
    pairs.write_with(writer, |chunk| flags_of(chunk))
}

/// Bit i is set where word i is not zero.
#[target_feature(enable = "avx512f")]
#[inline]
fn flags_of(chunk: &Chunk) -> u64 {
    let sixteens = chunk.as_chunks::<{ CHUNK_WORDS / 4 }>().0;
    (0..).zip(sixteens).fold(0, |flags, (i, sixteen)| {
        // SAFETY: the array holds the 16 words of a register.
        let words = unsafe { _mm512_loadu_si512(sixteen.as_ptr().cast()) };
        flags | (u64::from(_mm512_test_epi32_mask(words, words)) << (16 * i))
    })
}
