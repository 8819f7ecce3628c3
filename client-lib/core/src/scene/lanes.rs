//! Comparing integers lane by lane.
#![allow(unsafe_code)]

/// Four integers: a register of every processor with SIMD.
pub(super) type Lanes = [i32; 4];

/// Whether no lane exceeds that of the limits.
///
/// Written out: compilers make a loop over lanes a chain of branches, each of which is hard to predict.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn none_exceeds(lanes: [Lanes; 2], limits: [Lanes; 2]) -> bool {
    use std::arch::x86_64::{__m128i, _mm_cmpgt_epi32, _mm_movemask_epi8, _mm_or_si128};
    let [low, high]: [__m128i; 2] = lanes.map(bytemuck::cast);
    let [low_limit, high_limit]: [__m128i; 2] = limits.map(bytemuck::cast);
    // SAFETY: every x86-64 processor has SSE2.
    let exceeding = unsafe {
        let (low, high) = (_mm_cmpgt_epi32(low, low_limit), _mm_cmpgt_epi32(high, high_limit));
        _mm_movemask_epi8(_mm_or_si128(low, high))
    };
    exceeding == 0
}

/// Whether no lane exceeds that of the limits.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(super) fn none_exceeds(lanes: [Lanes; 2], limits: [Lanes; 2]) -> bool {
    let mut exceeds = false;
    for half in 0..2 {
        for lane in 0..4 {
            exceeds |= lanes[half][lane] > limits[half][lane];
        }
    }
    !exceeds
}
