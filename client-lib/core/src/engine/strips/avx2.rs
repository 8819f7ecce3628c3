//! Strips with AVX2: two halves of eight columns.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::batch::{check_bounds, count_columns};
use super::ordered::KeyArrays;
use crate::engine::{AvailableIsa, Isa};

/// Tests every strip; see [`super::StripBatch::test`]. Returns the columns compared.
pub(super) fn test(
    keys: &KeyArrays<'_>,
    rows: &[u32],
    starts: &[u32],
    lanes: &mut [u16],
    isa: AvailableIsa,
) -> u64 {
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { check_and_test(keys, rows, starts, lanes) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn check_and_test(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) -> u64 {
    check_bounds(keys, rows, starts, lanes);
    let compared = count_columns(lanes);
    // SAFETY: `check_bounds` has seen that every row and 16 columns from every start are in the
    // arrays.
    unsafe { test_checked(keys, rows, starts, lanes) }
    compared
}

/// # Safety
/// Every row, and 16 columns from every start, must lie in all six arrays.
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
#[inline]
unsafe fn test_checked(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) {
    let keys = keys.map(<[i32]>::as_ptr);
    for ((&row, &start), lanes) in rows.iter().zip(starts).zip(lanes) {
        let mut apart = [_mm256_setzero_si256(); 2];
        for axis in 0..3 {
            // SAFETY: the caller vouches for `row`.
            let (row_min, row_max) = unsafe {
                (
                    _mm256_set1_epi32(*keys[axis].add(row as usize)),
                    _mm256_set1_epi32(*keys[3 + axis].add(row as usize)),
                )
            };
            for (half, apart) in apart.iter_mut().enumerate() {
                let first = start as usize + 8 * half;
                // SAFETY: the caller vouches for 16 keys from `start`.
                let (min, max) = unsafe {
                    (
                        _mm256_loadu_si256(keys[axis].add(first).cast()),
                        _mm256_loadu_si256(keys[3 + axis].add(first).cast()),
                    )
                };
                let beyond = _mm256_cmpgt_epi32(min, row_max);
                let before = _mm256_cmpgt_epi32(row_min, max);
                *apart = _mm256_or_si256(*apart, _mm256_or_si256(beyond, before));
            }
        }
        let [low, high] = apart.map(|a| _mm256_movemask_ps(_mm256_castsi256_ps(a)) as u32);
        *lanes &= !(low | high << 8) as u16;
    }
}
