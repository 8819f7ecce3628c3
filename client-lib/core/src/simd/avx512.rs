//! Sixteen keys a register, with AVX-512: compares answer in bits.
#![allow(unsafe_code)]
// Thirty intrinsics by name would not help a reader.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{Simd, Squeeze};
use crate::aabb::Aabb;

/// Proof that the processor has AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// The proof.
    ///
    /// # Safety
    /// The processor must have AVX-512 F, BW, DQ and VL.
    #[inline(always)]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

impl Simd for Avx512 {
    type Keys = __m512i;
    type Lanes = __mmask16;
    type Met = __mmask16;

    const LANES: usize = 16;

    #[inline(always)]
    fn splat(self, key: i32) -> __m512i {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_set1_epi32(key) }
    }

    #[inline(always)]
    unsafe fn load_from(self, keys: *const i32) -> __m512i {
        // SAFETY: the caller vouches for 16 keys.
        unsafe { _mm512_loadu_si512(keys.cast()) }
    }

    #[inline(always)]
    unsafe fn store_to(self, keys: __m512i, to: *mut i32) {
        // SAFETY: the caller vouches for 16 keys.
        unsafe { _mm512_storeu_si512(to.cast(), keys) }
    }

    #[inline(always)]
    fn all_meet(self) -> __mmask16 {
        __mmask16::MAX
    }

    /// Two intervals meet where the larger min is at most the smaller max, and an empty one meets none;
    /// twice as many compares, of each min with the other max, would take longer.
    #[inline(always)]
    fn meet(self, met: __mmask16, [min, max]: [__m512i; 2], row: [__m512i; 2]) -> __mmask16 {
        // SAFETY: the processor has AVX-512.
        unsafe {
            let low = _mm512_max_epi32(min, row[0]);
            let high = _mm512_min_epi32(max, row[1]);
            _mm512_mask_cmple_epi32_mask(met, low, high)
        }
    }

    #[inline(always)]
    fn met_bits(self, met: __mmask16) -> u32 {
        u32::from(met)
    }

    #[inline(always)]
    fn above(self, a: __m512i, b: __m512i) -> __mmask16 {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_cmpgt_epi32_mask(a, b) }
    }

    #[inline(always)]
    fn equal(self, a: __m512i, b: __m512i) -> __mmask16 {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_cmpeq_epi32_mask(a, b) }
    }

    #[inline(always)]
    fn unordered(self, a: __m512i, b: __m512i) -> __mmask16 {
        // SAFETY: the processor has AVX-512.
        unsafe {
            let (a, b) = (_mm512_castsi512_ps(a), _mm512_castsi512_ps(b));
            _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(a, b)
        }
    }

    #[inline(always)]
    fn either(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a | b
    }

    #[inline(always)]
    fn bits(self, lanes: __mmask16) -> u32 {
        u32::from(lanes)
    }

    #[inline(always)]
    fn select(self, lanes: __mmask16, chosen: __m512i, others: __m512i) -> __m512i {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_mask_mov_epi32(others, lanes, chosen) }
    }

    #[inline(always)]
    fn order_keys(self, bits: __m512i) -> __m512i {
        // SAFETY: the processor has AVX-512.
        unsafe {
            let not_minus_zero = _mm512_cmpneq_epi32_mask(bits, _mm512_set1_epi32(i32::MIN));
            let flip = _mm512_srli_epi32::<1>(_mm512_srai_epi32::<31>(bits));
            _mm512_maskz_xor_epi32(not_minus_zero, bits, flip)
        }
    }

    /// Six registers hold 16 boxes as they lie in memory. The coordinates are first taken apart as
    /// 64-bit pairs (min.x min.y | min.z max.x | max.y max.z), three streams of 8 boxes by two shuffles
    /// each, and then pair from pair: 18 shuffles in all.
    #[inline(always)]
    fn coordinates(self, boxes: &[Aabb]) -> [__m512i; 6] {
        let words: &[[i32; 16]] = bytemuck::cast_slice(&boxes[..Self::LANES]);
        let mut r = [self.splat(0); 6];
        for (r, words) in r.iter_mut().zip(words) {
            *r = self.load(words);
        }
        // SAFETY: the processor has AVX-512.
        unsafe {
            // Pair s of box i is qword 3i + s of 24; qwords 16 and up lie in the third register.
            let first = [
                _mm512_setr_epi64(0, 3, 6, 9, 12, 15, 0, 0),
                _mm512_setr_epi64(1, 4, 7, 10, 13, 0, 0, 0),
                _mm512_setr_epi64(2, 5, 8, 11, 14, 0, 0, 0),
            ];
            let third = [
                _mm512_setr_epi64(0, 0, 0, 0, 0, 0, 2, 5),
                _mm512_setr_epi64(0, 0, 0, 0, 0, 0, 3, 6),
                _mm512_setr_epi64(0, 0, 0, 0, 0, 1, 4, 7),
            ];
            let from_third = [0b1100_0000, 0b1110_0000, 0b1110_0000];
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            let mut out = [_mm512_setzero_si512(); 6];
            for s in 0..3 {
                let mut halves = [_mm512_setzero_si512(); 2];
                for h in 0..2 {
                    let two = _mm512_permutex2var_epi64(r[3 * h], first[s], r[3 * h + 1]);
                    let last = r[3 * h + 2];
                    halves[h] = _mm512_mask_permutexvar_epi64(two, from_third[s], third[s], last);
                }
                out[2 * s] = _mm512_permutex2var_epi32(halves[0], even, halves[1]);
                out[2 * s + 1] = _mm512_permutex2var_epi32(halves[0], odd, halves[1]);
            }
            out
        }
    }

    #[inline(always)]
    fn words_of<'a>(self, record: impl Fn(usize) -> &'a [i32; 8]) -> [__m512i; 8] {
        // SAFETY: the processor has AVX-512, and a record is the 32 bytes of half a register.
        unsafe {
            // Records i and i + 8, then within each quarter words of records i and i + 1, i to i + 3.
            let mut two = [self.splat(0); 8];
            for (i, two) in two.iter_mut().enumerate() {
                let low = _mm256_loadu_si256(record(i).as_ptr().cast());
                let high = _mm256_loadu_si256(record(i + 8).as_ptr().cast());
                *two = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high);
            }
            let (mut four, mut eight) = ([self.splat(0); 8], [self.splat(0); 8]);
            for i in [0, 2, 4, 6] {
                four[i] = _mm512_unpacklo_epi32(two[i], two[i + 1]);
                four[i + 1] = _mm512_unpackhi_epi32(two[i], two[i + 1]);
            }
            for i in [0, 1, 4, 5] {
                let at = i / 4 * 4 + i % 4 * 2;
                eight[at] = _mm512_unpacklo_epi64(four[i], four[i + 2]);
                eight[at + 1] = _mm512_unpackhi_epi64(four[i], four[i + 2]);
            }
            // Register k has word k of records 0 to 3 and 8 to 11 in its even quarters and word k + 4 in
            // its odd ones, register k + 4 the same of the others.
            let low = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
            let high = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
            let mut words = [self.splat(0); 8];
            for k in 0..4 {
                words[k] = _mm512_permutex2var_epi64(eight[k], low, eight[4 + k]);
                words[4 + k] = _mm512_permutex2var_epi64(eight[k], high, eight[4 + k]);
            }
            words
        }
    }
}

impl Squeeze for Avx512 {
    #[inline(always)]
    fn or_where(self, [one, other]: [__mmask16; 2], a: __m512i, b: __m512i) -> __m512i {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_mask_or_epi32(a, one & other, a, b) }
    }

    #[inline(always)]
    fn widen(self, numbers: &[u16]) -> __m512i {
        // SAFETY: the processor has AVX-512, and the slice is 16 u16, 32 bytes.
        unsafe { _mm512_cvtepu16_epi32(_mm256_loadu_si256(numbers[..Self::LANES].as_ptr().cast())) }
    }

    #[inline(always)]
    fn squeeze(self, set: u32, [a, b, c]: [__m512i; 3]) -> [__m512i; 3] {
        let set = set as __mmask16;
        // SAFETY: the processor has AVX-512.
        unsafe {
            [
                _mm512_maskz_compress_epi32(set, a),
                _mm512_maskz_compress_epi32(set, b),
                _mm512_maskz_compress_epi32(set, c),
            ]
        }
    }

    #[inline(always)]
    fn behind(self, keys: __m512i, first: u32) -> __m512i {
        // SAFETY: the processor has AVX-512.
        unsafe { _mm512_alignr_epi32::<15>(keys, _mm512_set1_epi32(first as i32)) }
    }

    #[inline(always)]
    fn strip_words(self, row: __m512i, start: __m512i, bits: __m512i) -> [__m512i; 3] {
        // SAFETY: the processor has AVX-512.
        unsafe {
            let twice = _mm512_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7);
            let second_of_two = _mm512_setr_epi32(0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1);
            let row = _mm512_permutexvar_epi32(twice, row);
            let start = _mm512_permutexvar_epi32(twice, start);
            let bits = _mm512_permutexvar_epi32(twice, bits);
            let block = _mm512_add_epi32(_mm512_srli_epi32::<5>(start), second_of_two);
            let shift = _mm512_and_si512(start, _mm512_set1_epi32(31));
            let first = _mm512_sllv_epi32(bits, shift);
            let past = _mm512_sub_epi32(_mm512_set1_epi32(32), shift);
            [row, block, _mm512_mask_srlv_epi32(first, 0xaaaa, bits, past)]
        }
    }
}
