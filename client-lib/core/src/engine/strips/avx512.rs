//! Strips with AVX-512: one strip is six loads and three compares into a mask register. Two intervals
//! meet where the larger min is at most the smaller max, and an empty one meets none; twice as many
//! compares, of each min with the other max, would take longer.
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
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { check_and_test(keys, rows, starts, lanes) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
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
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
unsafe fn test_checked(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) {
    let [min_x, min_y, min_z, max_x, max_y, max_z] = keys.map(<[i32]>::as_ptr);
    for ((&row, &start), lanes) in rows.iter().zip(starts).zip(lanes) {
        let (row, start) = (row as usize, start as usize);
        // SAFETY: the caller vouches for `row` and for 16 keys from `start`.
        unsafe {
            let columns = |key: *const i32| _mm512_loadu_si512(key.add(start).cast());
            let of_row = |key: *const i32| _mm512_set1_epi32(*key.add(row));
            let mut hit = *lanes;
            for (min, max) in [(min_x, max_x), (min_y, max_y), (min_z, max_z)] {
                let low = _mm512_max_epi32(columns(min), of_row(min));
                let high = _mm512_min_epi32(columns(max), of_row(max));
                hit = _mm512_mask_cmple_epi32_mask(hit, low, high);
            }
            *lanes = hit;
        }
    }
}
