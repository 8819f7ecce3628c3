//! Strips with NEON: four quarters of four columns.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::aarch64::*;

use super::batch::{check_bounds, count_columns};
use super::ordered::KeyArrays;

/// Tests every strip; see [`super::StripBatch::test`]. Returns the columns compared.
pub(super) fn test(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) -> u64 {
    check_bounds(keys, rows, starts, lanes);
    let compared = count_columns(lanes);
    // SAFETY: every aarch64 has NEON, and `check_bounds` has seen that every row and 16 columns from
    // every start are in the arrays.
    unsafe { test_checked(keys, rows, starts, lanes) }
    compared
}

/// # Safety
/// Every row, and 16 columns from every start, must lie in all six arrays.
#[target_feature(enable = "neon")]
unsafe fn test_checked(keys: &KeyArrays<'_>, rows: &[u32], starts: &[u32], lanes: &mut [u16]) {
    let keys = keys.map(<[i32]>::as_ptr);
    for ((&row, &start), lanes) in rows.iter().zip(starts).zip(lanes) {
        // SAFETY: the caller vouches for `row`.
        let of_row = keys.map(|key| unsafe { vdupq_n_s32(*key.add(row as usize)) });
        let quarters = [0, 4, 8, 12].map(|quarter| {
            let mut hit = vdupq_n_u32(u32::MAX);
            for axis in 0..3 {
                let first = start as usize + quarter;
                // SAFETY: the caller vouches for 16 keys from `start`.
                let (min, max) = unsafe {
                    (vld1q_s32(keys[axis].add(first)), vld1q_s32(keys[3 + axis].add(first)))
                };
                hit = vandq_u32(hit, vcleq_s32(min, of_row[3 + axis]));
                hit = vandq_u32(hit, vcleq_s32(of_row[axis], max));
            }
            vmovn_u32(hit)
        });
        let [a, b, c, d] = quarters;
        let halves = [vcombine_u16(a, b), vcombine_u16(c, d)].map(|half| byte_of(half));
        *lanes &= u16::from_le_bytes(halves);
    }
}

/// Bit i: lane i is all ones, of lanes that are that or zero.
#[target_feature(enable = "neon")]
#[inline]
fn byte_of(lanes: uint16x8_t) -> u8 {
    const WEIGHTS: [u8; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
    // SAFETY: 8 bytes are what is loaded.
    let weights = unsafe { vld1_u8(WEIGHTS.as_ptr()) };
    vaddv_u8(vand_u8(vmovn_u16(lanes), weights))
}
