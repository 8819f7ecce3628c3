//! Comparison with NEON: 4 columns a compare.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::aarch64::*;

use super::kernel::{Columns, Kernel};
use crate::aabb::KeyBox;

/// NEON is part of every aarch64, so that this kernel needs no detection.
pub(super) struct Neon;

impl Kernel for Neon {
    type Row = [int32x4_t; 6];

    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> Self::Row {
        let [x, y, z] = key.min;
        let [u, v, w] = key.max;
        // SAFETY: every aarch64 has NEON.
        [x, y, z, u, v, w].map(|k| unsafe { vdupq_n_s32(k) })
    }

    #[inline(always)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64 {
        const WEIGHTS: [u8; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
        let mut bits = 0;
        for eighth in 0..8 {
            // SAFETY: every aarch64 has NEON; a column holds 64 keys, so that the sixteen loads of
            // 4 end where it does.
            let byte = unsafe {
                let quad = |first: usize| -> uint16x4_t {
                    let load = |c: usize| vld1q_s32(columns[c].as_ptr().add(first));
                    let mut hit = vdupq_n_u32(u32::MAX);
                    for axis in 0..3 {
                        hit = vandq_u32(hit, vcleq_s32(row[axis], load(3 + axis)));
                        hit = vandq_u32(hit, vcleq_s32(load(axis), row[3 + axis]));
                    }
                    vmovn_u32(hit)
                };
                let lanes = vmovn_u16(vcombine_u16(quad(8 * eighth), quad(8 * eighth + 4)));
                vaddv_u8(vand_u8(lanes, vld1_u8(WEIGHTS.as_ptr())))
            };
            bits |= u64::from(byte) << (8 * eighth);
        }
        bits
    }
}
