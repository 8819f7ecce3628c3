//! Fetching with AVX-512: 16 records of 32 bytes a step, turned into eight registers of 16 words.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::super::homes::REACH_SHIFT;
use super::super::level::Reach;
use super::super::tile::Record;
use crate::engine::ingest::order_keys;
use crate::engine::strips::KeyArraysMut;
use crate::engine::{AvailableIsa, Isa};

/// Boxes a step.
const STEP: usize = 16;

/// All whole steps; returns how many boxes that were.
pub(super) fn fetch(
    records: &[Record],
    keys: &mut KeyArraysMut<'_>,
    order: &mut [u32],
    reach: &mut [Reach],
    isa: AvailableIsa,
) -> usize {
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { fetch_steps(records, keys, order, reach) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn fetch_steps(
    records: &[Record],
    keys: &mut KeyArraysMut<'_>,
    order: &mut [u32],
    reach: &mut [Reach],
) -> usize {
    let orders = order.as_chunks_mut::<STEP>().0.iter_mut();
    let reaches = reach.as_chunks_mut::<STEP>().0.iter_mut();
    let mut done = 0;
    for (order, reach) in orders.zip(reaches) {
        let [coordinates @ .., index, home] = words_of(records, order);
        for (array, bits) in keys.iter_mut().zip::<[__m512i; 6]>(coordinates) {
            let out = &mut array[done..done + STEP];
            // SAFETY: `out` is 16 i32, 64 bytes, exclusively borrowed.
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), order_keys(bits)) };
        }
        // SAFETY: `order` is 16 u32, 64 bytes, exclusively borrowed.
        unsafe { _mm512_storeu_si512(order.as_mut_ptr().cast(), index) };
        let reaches = _mm512_cvtepi32_epi8(_mm512_srli_epi32::<REACH_SHIFT>(home));
        // SAFETY: `reach` is 16 u8, 16 bytes, exclusively borrowed.
        unsafe { _mm_storeu_si128(reach.as_mut_ptr().cast(), reaches) };
        done += STEP;
    }
    done
}

/// Word k of 16 records in register k, for all eight words.
#[inline]
#[target_feature(enable = "avx512f")]
fn words_of(records: &[Record], sources: &[u32; STEP]) -> [__m512i; 8] {
    const { assert!(size_of::<Record>() == 32) };
    let load = |i: usize| {
        let record = &records[sources[i] as usize];
        // SAFETY: a record is the 32 bytes of half a register.
        unsafe { _mm256_loadu_si256(std::ptr::from_ref(record).cast()) }
    };
    // Records i and i + 8, then within each quarter words of records i and i + 1, i to i + 3.
    let two: [__m512i; 8] = std::array::from_fn(|i| {
        _mm512_inserti64x4::<1>(_mm512_castsi256_si512(load(i)), load(i + 8))
    });
    let mut four = [_mm512_setzero_si512(); 8];
    for i in [0, 2, 4, 6] {
        four[i] = _mm512_unpacklo_epi32(two[i], two[i + 1]);
        four[i + 1] = _mm512_unpackhi_epi32(two[i], two[i + 1]);
    }
    let mut eight = [_mm512_setzero_si512(); 8];
    for i in [0, 4] {
        for word in [0, 1] {
            eight[i + 2 * word] = _mm512_unpacklo_epi64(four[i + word], four[i + 2 + word]);
            eight[i + 2 * word + 1] = _mm512_unpackhi_epi64(four[i + word], four[i + 2 + word]);
        }
    }
    // Register k has word k of records 0 to 3 and 8 to 11 in its even quarters and word k + 4 in
    // its odd ones, register k + 4 the same of the others.
    let low = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
    let high = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
    std::array::from_fn(|k| {
        let quarters = if k < 4 { low } else { high };
        _mm512_permutex2var_epi64(eight[k % 4], quarters, eight[4 + k % 4])
    })
}
