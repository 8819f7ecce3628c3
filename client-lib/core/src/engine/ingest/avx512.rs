//! Ingest with AVX-512: 16 boxes a step.
//!
//! Six registers hold 16 boxes as they lie in memory. The coordinates are first taken apart as
//! 64-bit pairs (min.x min.y | min.z max.x | max.y max.z), three streams of 8 boxes by two shuffles
//! each, and then pair from pair: 18 shuffles in all.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::{ColumnsMut, note_group};
use crate::aabb::{Aabb, KeyBox};
use crate::engine::{AvailableIsa, Census, Isa};

/// Boxes a step.
const STEP: usize = 16;

/// Keys of all whole steps; returns how many boxes that were.
pub(super) fn fill(
    boxes: &[Aabb],
    columns: &mut ColumnsMut<'_>,
    census: &mut Census,
    isa: AvailableIsa,
) -> usize {
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { fill_steps(boxes, columns, census) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn fill_steps(boxes: &[Aabb], columns: &mut ColumnsMut<'_>, census: &mut Census) -> usize {
    let (steps, _) = boxes.as_chunks::<STEP>();
    let [c0, c1, c2, c3, c4, c5] = columns;
    let outs = c0.as_chunks_mut::<STEP>().0.iter_mut().zip(c1.as_chunks_mut::<STEP>().0);
    let outs = outs.zip(c2.as_chunks_mut::<STEP>().0).zip(c3.as_chunks_mut::<STEP>().0);
    let outs = outs.zip(c4.as_chunks_mut::<STEP>().0).zip(c5.as_chunks_mut::<STEP>().0);
    for (step, (boxes, (((((c0, c1), c2), c3), c4), c5))) in steps.iter().zip(outs).enumerate() {
        let (keys, nan, empty) = keys_of(&transpose(&load(boxes)));
        for (out, key) in [c0, c1, c2, c3, c4, c5].into_iter().zip(keys) {
            // SAFETY: `out` is 16 i32, 64 bytes, exclusively borrowed.
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), key) };
        }
        if (nan | empty) != 0 {
            note_group(census, step * STEP, u32::from(nan), u32::from(empty));
        }
    }
    steps.len() * STEP
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load(boxes: &[Aabb; STEP]) -> [__m512i; 6] {
    let words: &[[f32; 16]] = bytemuck::cast_slice(boxes.as_slice());
    // SAFETY: 16 boxes are 384 bytes: six times 64, and index 5 is the last of them.
    std::array::from_fn(|i| unsafe { _mm512_loadu_si512(words[i].as_ptr().cast()) })
}

/// Registers of 16 boxes in memory order → one register a coordinate.
#[inline]
#[target_feature(enable = "avx512f")]
fn transpose(r: &[__m512i; 6]) -> [__m512i; 6] {
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
            halves[h] = _mm512_mask_permutexvar_epi64(two, from_third[s], third[s], r[3 * h + 2]);
        }
        out[2 * s] = _mm512_permutex2var_epi32(halves[0], even, halves[1]);
        out[2 * s + 1] = _mm512_permutex2var_epi32(halves[0], odd, halves[1]);
    }
    out
}

/// Keys, and the masks of boxes with a NaN and of boxes with `min > max`.
#[inline]
#[target_feature(enable = "avx512f")]
fn keys_of(bits: &[__m512i; 6]) -> ([__m512i; 6], __mmask16, __mmask16) {
    let (mut nan, mut empty) = (0, 0);
    let mut keys = bits.map(|b| order_keys(b));
    for axis in 0..3 {
        // NaN or not is all that this asks of the floats, and no CPU mode changes that answer.
        nan |= _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(
            _mm512_castsi512_ps(bits[axis]),
            _mm512_castsi512_ps(bits[3 + axis]),
        );
        empty |= _mm512_cmpgt_epi32_mask(keys[axis], keys[3 + axis]);
    }
    for axis in 0..3 {
        let nothing = nan | empty;
        keys[axis] = _mm512_mask_mov_epi32(
            keys[axis],
            nothing,
            _mm512_set1_epi32(KeyBox::NOTHING.min[axis]),
        );
        keys[3 + axis] = _mm512_mask_mov_epi32(
            keys[3 + axis],
            nothing,
            _mm512_set1_epi32(KeyBox::NOTHING.max[axis]),
        );
    }
    (keys, nan, empty)
}

/// `order_key` of `crate::aabb`, 16 at a time.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn order_keys(bits: __m512i) -> __m512i {
    let not_minus_zero = _mm512_cmpneq_epi32_mask(bits, _mm512_set1_epi32(i32::MIN));
    let flip = _mm512_srli_epi32::<1>(_mm512_srai_epi32::<31>(bits));
    _mm512_maskz_xor_epi32(not_minus_zero, bits, flip)
}
