//! Ingest with AVX2: 8 boxes a step.
//!
//! Each box is read by two overlapping 16-byte loads, `min.x min.y min.z max.x` and
//! `min.z max.x max.y max.z`; boxes 0 to 3 stand in the low halves of four registers, boxes 4 to 7
//! in the high halves, and two 4×4 transpositions (the second by half) give the six coordinates.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{ColumnsMut, note_group};
use crate::aabb::{Aabb, KeyBox};
use crate::engine::{AvailableIsa, Census, Isa};

/// Boxes a step.
const STEP: usize = 8;

/// Keys of all whole steps; returns how many boxes that were.
pub(super) fn fill(
    boxes: &[Aabb],
    columns: &mut ColumnsMut<'_>,
    census: &mut Census,
    isa: AvailableIsa,
) -> usize {
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { fill_steps(boxes, columns, census) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn fill_steps(boxes: &[Aabb], columns: &mut ColumnsMut<'_>, census: &mut Census) -> usize {
    let (steps, _) = boxes.as_chunks::<STEP>();
    for (step, boxes) in steps.iter().enumerate() {
        let (keys, nan, empty) = keys_of(transpose(boxes));
        for (column, key) in columns.iter_mut().zip(keys) {
            let out = &mut column[step * STEP..][..STEP];
            // SAFETY: `out` is 8 i32, 32 bytes, exclusively borrowed.
            unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), key) };
        }
        if (nan | empty) != 0 {
            note_group(census, step * STEP, nan, empty);
        }
    }
    steps.len() * STEP
}

/// 8 boxes in memory order → one register a coordinate.
#[inline]
#[target_feature(enable = "avx2")]
fn transpose(boxes: &[Aabb; STEP]) -> [__m256i; 6] {
    let words: &[[f32; 6]] = bytemuck::cast_slice(boxes.as_slice());
    let quad = |first: usize| -> [__m256; 4] {
        std::array::from_fn(|i| {
            let (low, high) = (&words[i][first..first + 4], &words[i + 4][first..first + 4]);
            // SAFETY: both slices are 4 f32, 16 bytes.
            unsafe { _mm256_loadu2_m128(high.as_ptr(), low.as_ptr()) }
        })
    };
    let [a, b, c, d] = quad(0);
    let (ab_low, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
    let (cd_low, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
    let [e, f, g, h] = quad(2);
    let (ef_high, gh_high) = (_mm256_unpackhi_ps(e, f), _mm256_unpackhi_ps(g, h));
    [
        _mm256_shuffle_ps::<0b01_00_01_00>(ab_low, cd_low),
        _mm256_shuffle_ps::<0b11_10_11_10>(ab_low, cd_low),
        _mm256_shuffle_ps::<0b01_00_01_00>(ab_high, cd_high),
        _mm256_shuffle_ps::<0b11_10_11_10>(ab_high, cd_high),
        _mm256_shuffle_ps::<0b01_00_01_00>(ef_high, gh_high),
        _mm256_shuffle_ps::<0b11_10_11_10>(ef_high, gh_high),
    ]
    .map(|r| _mm256_castps_si256(r))
}

/// Keys, and the masks of boxes with a NaN and of boxes with `min > max`.
#[inline]
#[target_feature(enable = "avx2")]
fn keys_of(bits: [__m256i; 6]) -> ([__m256i; 6], u32, u32) {
    let (mut nan, mut empty) = (_mm256_setzero_si256(), _mm256_setzero_si256());
    let mut keys = bits.map(|b| order_keys(b));
    for axis in 0..3 {
        // NaN or not is all that this asks of the floats, and no CPU mode changes that answer.
        let unordered = _mm256_cmp_ps::<_CMP_UNORD_Q>(
            _mm256_castsi256_ps(bits[axis]),
            _mm256_castsi256_ps(bits[3 + axis]),
        );
        nan = _mm256_or_si256(nan, _mm256_castps_si256(unordered));
        empty = _mm256_or_si256(empty, _mm256_cmpgt_epi32(keys[axis], keys[3 + axis]));
    }
    let nothing = _mm256_or_si256(nan, empty);
    for axis in 0..3 {
        let (min, max) = (KeyBox::NOTHING.min[axis], KeyBox::NOTHING.max[axis]);
        keys[axis] = _mm256_blendv_epi8(keys[axis], _mm256_set1_epi32(min), nothing);
        keys[3 + axis] = _mm256_blendv_epi8(keys[3 + axis], _mm256_set1_epi32(max), nothing);
    }
    (keys, lanes(nan), lanes(empty))
}

/// The sign bits of 8 lanes.
#[inline]
#[target_feature(enable = "avx2")]
fn lanes(mask: __m256i) -> u32 {
    _mm256_movemask_ps(_mm256_castsi256_ps(mask)) as u32
}

/// `order_key` of `crate::aabb`, 8 at a time.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn order_keys(bits: __m256i) -> __m256i {
    let minus_zero = _mm256_cmpeq_epi32(bits, _mm256_set1_epi32(i32::MIN));
    let flip = _mm256_srli_epi32::<1>(_mm256_srai_epi32::<31>(bits));
    _mm256_andnot_si256(minus_zero, _mm256_xor_si256(bits, flip))
}
