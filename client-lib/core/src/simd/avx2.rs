//! Eight keys a register, with AVX2.
#![allow(unsafe_code)]
// Thirty intrinsics by name would not help a reader.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{Simd, Squeeze};
use crate::aabb::Aabb;

/// Proof that the processor has AVX2.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(());

impl Avx2 {
    /// The proof.
    ///
    /// # Safety
    /// The processor must have AVX2.
    #[inline(always)]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

/// Byte k of entry `set`: the k-th lane of `set`. Those behind the last one are 0. 2 KiB.
const LANES_OF: [[u8; 8]; 256] = {
    let mut all = [[0; 8]; 256];
    let mut set = 0;
    while set < all.len() {
        let (mut lane, mut kept) = (0, 0);
        while lane < 8 {
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

// SAFETY of all calls below: an `Avx2` exists only where the processor has the instructions. What is read
// and written by address is named beside it.
impl Simd for Avx2 {
    type Keys = __m256i;
    type Lanes = __m256i;
    /// Turned round: the lanes that are apart, whose first set is the compare of the first axis.
    type Met = __m256i;

    const LANES: usize = 8;

    #[inline(always)]
    fn splat(self, key: i32) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_set1_epi32(key) }
    }

    #[inline(always)]
    unsafe fn load_from(self, keys: *const i32) -> __m256i {
        // SAFETY: the caller vouches for 8 keys.
        unsafe { _mm256_loadu_si256(keys.cast()) }
    }

    #[inline(always)]
    unsafe fn store_to(self, keys: __m256i, to: *mut i32) {
        // SAFETY: the caller vouches for 8 keys.
        unsafe { _mm256_storeu_si256(to.cast(), keys) }
    }

    #[inline(always)]
    fn all_meet(self) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_setzero_si256() }
    }

    #[inline(always)]
    fn meet(self, apart: __m256i, [min, max]: [__m256i; 2], row: [__m256i; 2]) -> __m256i {
        let beyond = self.above(min, row[1]);
        let before = self.above(row[0], max);
        self.either(apart, self.either(beyond, before))
    }

    #[inline(always)]
    fn met_bits(self, apart: __m256i) -> u32 {
        !self.bits(apart) & 0xff
    }

    #[inline(always)]
    fn above(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_cmpgt_epi32(a, b) }
    }

    #[inline(always)]
    fn equal(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_cmpeq_epi32(a, b) }
    }

    #[inline(always)]
    fn unordered(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe {
            let (a, b) = (_mm256_castsi256_ps(a), _mm256_castsi256_ps(b));
            _mm256_castps_si256(_mm256_cmp_ps::<_CMP_UNORD_Q>(a, b))
        }
    }

    #[inline(always)]
    fn either(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_or_si256(a, b) }
    }

    #[inline(always)]
    fn bits(self, lanes: __m256i) -> u32 {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_movemask_ps(_mm256_castsi256_ps(lanes)) as u32 }
    }

    #[inline(always)]
    fn select(self, lanes: __m256i, chosen: __m256i, others: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_blendv_epi8(others, chosen, lanes) }
    }

    #[inline(always)]
    fn order_keys(self, bits: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe {
            let minus_zero = _mm256_cmpeq_epi32(bits, _mm256_set1_epi32(i32::MIN));
            let flip = _mm256_srli_epi32::<1>(_mm256_srai_epi32::<31>(bits));
            _mm256_andnot_si256(minus_zero, _mm256_xor_si256(bits, flip))
        }
    }

    /// Each box is read by two overlapping 16-byte loads, `min.x min.y min.z max.x` and
    /// `min.z max.x max.y max.z`; boxes 0 to 3 stand in the low halves of four registers, boxes 4 to 7
    /// in the high halves, and two 4×4 transpositions (the second by half) give the six coordinates.
    #[inline(always)]
    fn coordinates(self, boxes: &[Aabb]) -> [__m256i; 6] {
        let words: &[[f32; 6]] = bytemuck::cast_slice(&boxes[..Self::LANES]);
        // SAFETY: the processor has AVX2, and all slices are 4 f32, 16 bytes.
        unsafe {
            let mut quads = [[_mm256_setzero_ps(); 4]; 2];
            for (half, quads) in quads.iter_mut().enumerate() {
                let first = 2 * half;
                for (i, quad) in quads.iter_mut().enumerate() {
                    let (low, high) = (&words[i][first..][..4], &words[i + 4][first..][..4]);
                    *quad = _mm256_loadu2_m128(high.as_ptr(), low.as_ptr());
                }
            }
            let [[a, b, c, d], [e, f, g, h]] = quads;
            let (ab_low, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (cd_low, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            let (ef_high, gh_high) = (_mm256_unpackhi_ps(e, f), _mm256_unpackhi_ps(g, h));
            [
                _mm256_castps_si256(_mm256_shuffle_ps::<0b01_00_01_00>(ab_low, cd_low)),
                _mm256_castps_si256(_mm256_shuffle_ps::<0b11_10_11_10>(ab_low, cd_low)),
                _mm256_castps_si256(_mm256_shuffle_ps::<0b01_00_01_00>(ab_high, cd_high)),
                _mm256_castps_si256(_mm256_shuffle_ps::<0b11_10_11_10>(ab_high, cd_high)),
                _mm256_castps_si256(_mm256_shuffle_ps::<0b01_00_01_00>(ef_high, gh_high)),
                _mm256_castps_si256(_mm256_shuffle_ps::<0b11_10_11_10>(ef_high, gh_high)),
            ]
        }
    }

    #[inline(always)]
    fn words_of<'a>(self, record: impl Fn(usize) -> &'a [i32; 8]) -> [__m256i; 8] {
        let mut one = [self.all_meet(); 8];
        for (i, one) in one.iter_mut().enumerate() {
            *one = self.load(record(i));
        }
        let (mut two, mut four) = ([self.all_meet(); 8], [self.all_meet(); 8]);
        // SAFETY: the processor has AVX2.
        unsafe {
            // Within each half words of records i and i + 1, then i to i + 3.
            for i in [0, 2, 4, 6] {
                two[i] = _mm256_unpacklo_epi32(one[i], one[i + 1]);
                two[i + 1] = _mm256_unpackhi_epi32(one[i], one[i + 1]);
            }
            for i in [0, 1, 4, 5] {
                let at = i / 4 * 4 + i % 4 * 2;
                four[at] = _mm256_unpacklo_epi64(two[i], two[i + 2]);
                four[at + 1] = _mm256_unpackhi_epi64(two[i], two[i + 2]);
            }
            // Register k has word k of records 0 to 3 in its low half and word k + 4 in its high one,
            // register k + 4 the same of the others.
            let mut words = [self.all_meet(); 8];
            for k in 0..4 {
                words[k] = _mm256_permute2x128_si256::<0x20>(four[k], four[4 + k]);
                words[4 + k] = _mm256_permute2x128_si256::<0x31>(four[k], four[4 + k]);
            }
            words
        }
    }
}

impl Squeeze for Avx2 {
    #[inline(always)]
    fn or_where(self, [one, other]: [__m256i; 2], a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_or_si256(a, _mm256_and_si256(_mm256_and_si256(one, other), b)) }
    }

    #[inline(always)]
    fn widen(self, numbers: &[u16]) -> __m256i {
        // SAFETY: the processor has AVX2, and the slice is 8 u16, 16 bytes.
        unsafe { _mm256_cvtepu16_epi32(_mm_loadu_si128(numbers[..Self::LANES].as_ptr().cast())) }
    }

    /// By a table: AVX-512 has an instruction for it.
    #[inline(always)]
    fn squeeze(self, set: u32, [a, b, c]: [__m256i; 3]) -> [__m256i; 3] {
        // SAFETY: the processor has AVX2, and 8 bytes are what is loaded.
        unsafe {
            let lanes = _mm_loadl_epi64(LANES_OF[set as usize % 256].as_ptr().cast());
            let lanes = _mm256_cvtepu8_epi32(lanes);
            [
                _mm256_permutevar8x32_epi32(a, lanes),
                _mm256_permutevar8x32_epi32(b, lanes),
                _mm256_permutevar8x32_epi32(c, lanes),
            ]
        }
    }

    #[inline(always)]
    fn behind(self, keys: __m256i, first: u32) -> __m256i {
        // SAFETY: the processor has AVX2.
        unsafe {
            let moved =
                _mm256_permutevar8x32_epi32(keys, _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6));
            _mm256_blend_epi32::<1>(moved, _mm256_set1_epi32(first as i32))
        }
    }

    #[inline(always)]
    fn strip_words(self, row: __m256i, start: __m256i, bits: __m256i) -> [__m256i; 3] {
        // SAFETY: the processor has AVX2.
        unsafe {
            let twice = _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3);
            let row = _mm256_permutevar8x32_epi32(row, twice);
            let start = _mm256_permutevar8x32_epi32(start, twice);
            let bits = _mm256_permutevar8x32_epi32(bits, twice);
            let second_of_two = _mm256_setr_epi32(0, 1, 0, 1, 0, 1, 0, 1);
            let block = _mm256_add_epi32(_mm256_srli_epi32::<5>(start), second_of_two);
            let shift = _mm256_and_si256(start, _mm256_set1_epi32(31));
            let first = _mm256_sllv_epi32(bits, shift);
            let past = _mm256_sub_epi32(_mm256_set1_epi32(32), shift);
            let second = _mm256_srlv_epi32(bits, past);
            [row, block, _mm256_blend_epi32::<0b1010_1010>(first, second)]
        }
    }
}
