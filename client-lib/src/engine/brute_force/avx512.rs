//! Comparison with AVX-512: 16 columns a compare, whose answer is 16 mask bits as they are.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;
use std::ops::Range;

use super::bitmaps::Bitmaps;
use super::candidates::Candidates;
use super::kernel::{Columns, Kernel};
use super::search::{self, Scene};
use super::words::WordList;
use crate::aabb::KeyBox;
use crate::engine::ingest::ColumnWords;
use crate::engine::{AvailableIsa, Isa};

struct Avx512;

impl Kernel for Avx512 {
    type Row = [__m512i; 6];

    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> Self::Row {
        let [x, y, z] = key.min;
        let [u, v, w] = key.max;
        // SAFETY: the caller vouches for AVX-512 F.
        [x, y, z, u, v, w].map(|k| unsafe { _mm512_set1_epi32(k) })
    }

    #[inline(always)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64 {
        let mut bits = 0;
        for quarter in 0..4 {
            let mut mask: __mmask16 = !0;
            for axis in 0..3 {
                // SAFETY: the caller vouches for AVX-512 F; a column holds 64 keys, so that the
                // four loads of 16 end where it does.
                unsafe {
                    let min = _mm512_loadu_si512(columns[axis].as_ptr().add(16 * quarter).cast());
                    let max =
                        _mm512_loadu_si512(columns[3 + axis].as_ptr().add(16 * quarter).cast());
                    mask = _mm512_mask_cmple_epi32_mask(mask, row[axis], max);
                    mask = _mm512_mask_cmple_epi32_mask(mask, min, row[3 + axis]);
                }
            }
            bits |= u64::from(mask) << (16 * quarter);
        }
        bits
    }
}

/// [`search::find`] with this instruction set.
pub(super) fn find(
    scene: &Scene<'_>,
    rows: Range<usize>,
    candidates: &mut Candidates,
    found: &mut WordList,
    isa: AvailableIsa,
) -> u64 {
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
    fn run(
        scene: &Scene<'_>,
        rows: Range<usize>,
        candidates: &mut Candidates,
        found: &mut WordList,
    ) -> u64 {
        // SAFETY: this function is compiled for the kernel's features.
        unsafe { search::find::<Avx512>(scene, rows, candidates, found) }
    }
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(scene, rows, candidates, found) }
}

/// [`Bitmaps::build`] with this instruction set.
pub(super) fn build(bitmaps: &mut Bitmaps, columns: &ColumnWords<'_>, n: usize, isa: AvailableIsa) {
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
    fn run(bitmaps: &mut Bitmaps, columns: &ColumnWords<'_>, n: usize) {
        // SAFETY: this function is compiled for the kernel's features.
        unsafe { bitmaps.build::<Avx512>(columns, n) };
    }
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(bitmaps, columns, n) }
}
