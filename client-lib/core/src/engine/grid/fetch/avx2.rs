//! Fetching with AVX2: 8 records of 32 bytes a step, turned into eight registers of 8 words.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::super::homes::REACH_SHIFT;
use super::super::level::Reach;
use super::super::tile::Record;
use crate::engine::ingest::order_keys_avx2;
use crate::engine::strips::KeyArraysMut;
use crate::engine::{AvailableIsa, Isa};

/// Boxes a step.
const STEP: usize = 8;

/// All whole steps; returns how many boxes that were.
pub(super) fn fetch(
    records: &[Record],
    keys: &mut KeyArraysMut<'_>,
    order: &mut [u32],
    reach: &mut [Reach],
    isa: AvailableIsa,
) -> usize {
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { fetch_steps(records, keys, order, reach) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
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
        for (array, bits) in keys.iter_mut().zip::<[__m256i; 6]>(coordinates) {
            let out = &mut array[done..done + STEP];
            // SAFETY: `out` is 8 i32, 32 bytes, exclusively borrowed.
            unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), order_keys_avx2(bits)) };
        }
        let mut homes = [0u32; STEP];
        // SAFETY: `order` and `homes` are 8 u32 each, 32 bytes, exclusively borrowed.
        unsafe {
            _mm256_storeu_si256(order.as_mut_ptr().cast(), index);
            _mm256_storeu_si256(homes.as_mut_ptr().cast(), home);
        }
        *reach = homes.map(|home| (home >> REACH_SHIFT) as Reach);
        done += STEP;
    }
    done
}

/// Word k of 8 records in register k, for all eight words.
#[inline]
#[target_feature(enable = "avx2")]
fn words_of(records: &[Record], sources: &[u32; STEP]) -> [__m256i; 8] {
    const { assert!(size_of::<Record>() == 32) };
    let one = sources.map(|source| {
        let record = &records[source as usize];
        // SAFETY: a record is the 32 bytes of a register.
        unsafe { _mm256_loadu_si256(std::ptr::from_ref(record).cast()) }
    });
    // Within each half words of records i and i + 1, then i to i + 3.
    let mut two = [_mm256_setzero_si256(); 8];
    for i in [0, 2, 4, 6] {
        two[i] = _mm256_unpacklo_epi32(one[i], one[i + 1]);
        two[i + 1] = _mm256_unpackhi_epi32(one[i], one[i + 1]);
    }
    let mut four = [_mm256_setzero_si256(); 8];
    for i in [0, 4] {
        for word in [0, 1] {
            four[i + 2 * word] = _mm256_unpacklo_epi64(two[i + word], two[i + 2 + word]);
            four[i + 2 * word + 1] = _mm256_unpackhi_epi64(two[i + word], two[i + 2 + word]);
        }
    }
    // Register k has word k of records 0 to 3 in its low half and word k + 4 in its high one,
    // register k + 4 the same of the others.
    std::array::from_fn(|k| {
        let (first, second) = (four[k % 4], four[4 + k % 4]);
        if k < 4 {
            _mm256_permute2x128_si256::<0x20>(first, second)
        } else {
            _mm256_permute2x128_si256::<0x31>(first, second)
        }
    })
}
