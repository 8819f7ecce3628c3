//! Lanes of an AVX2 register, squeezed together by a table: AVX-512 has an instruction for it.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

pub(super) const LANES: usize = 8;

/// Byte k of entry `set`: the k-th lane of `set`. Those behind the last one are 0. 2 KiB.
const LANES_OF: [[u8; LANES]; 256] = {
    let mut all = [[0; LANES]; 256];
    let mut set = 0;
    while set < all.len() {
        let (mut lane, mut kept) = (0, 0);
        while lane < LANES {
            if set >> lane & 1 != 0 {
                all[set][kept] = lane as u8;
                kept += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    all
};

/// The lanes of `set`, for a permutation that brings them to the front.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn lanes_first(set: u8) -> __m256i {
    // SAFETY: 8 bytes are what is loaded.
    let lanes = unsafe { _mm_loadl_epi64(LANES_OF[usize::from(set)].as_ptr().cast()) };
    _mm256_cvtepu8_epi32(lanes)
}

/// Eight words from `at` on.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn load_at(words: &[u32], at: usize) -> __m256i {
    let words = &words[at..at + LANES];
    // SAFETY: 8 u32 are the 32 bytes of a register.
    unsafe { _mm256_loadu_si256(words.as_ptr().cast()) }
}

/// Writes eight words from `at` on.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) fn store(words: &mut [u32], at: usize, register: __m256i) {
    let words = &mut words[at..at + LANES];
    // SAFETY: 8 u32, exclusively borrowed, are the 32 bytes of a register.
    unsafe { _mm256_storeu_si256(words.as_mut_ptr().cast(), register) }
}
