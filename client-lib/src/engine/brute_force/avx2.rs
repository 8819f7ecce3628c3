//! Comparison with AVX2: 8 columns a compare.
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

struct Avx2;

impl Kernel for Avx2 {
    type Row = [__m256i; 6];

    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> Self::Row {
        let [x, y, z] = key.min;
        let [u, v, w] = key.max;
        // SAFETY: the caller vouches for AVX2.
        [x, y, z, u, v, w].map(|k| unsafe { _mm256_set1_epi32(k) })
    }

    #[inline(always)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64 {
        let mut bits = 0;
        for eighth in 0..8 {
            // SAFETY: the caller vouches for AVX2; a column holds 64 keys, so that the eight loads
            // of 8 end where it does.
            let apart = unsafe {
                let load = |c: usize| -> __m256i {
                    _mm256_loadu_si256(columns[c].as_ptr().add(8 * eighth).cast())
                };
                // There is only "greater": gather what keeps two boxes apart.
                let mut apart = _mm256_setzero_si256();
                for axis in 0..3 {
                    let below = _mm256_cmpgt_epi32(row[axis], load(3 + axis));
                    let above = _mm256_cmpgt_epi32(load(axis), row[3 + axis]);
                    apart = _mm256_or_si256(apart, _mm256_or_si256(below, above));
                }
                _mm256_movemask_ps(_mm256_castsi256_ps(apart))
            };
            bits |= u64::from(!(apart as u8)) << (8 * eighth);
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
    #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
    fn run(
        scene: &Scene<'_>,
        rows: Range<usize>,
        candidates: &mut Candidates,
        found: &mut WordList,
    ) -> u64 {
        // SAFETY: this function is compiled for the kernel's features.
        unsafe { search::find::<Avx2>(scene, rows, candidates, found) }
    }
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(scene, rows, candidates, found) }
}

/// [`Bitmaps::build`] with this instruction set.
pub(super) fn build(bitmaps: &mut Bitmaps, columns: &ColumnWords<'_>, n: usize, isa: AvailableIsa) {
    #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
    fn run(bitmaps: &mut Bitmaps, columns: &ColumnWords<'_>, n: usize) {
        // SAFETY: this function is compiled for the kernel's features.
        unsafe { bitmaps.build::<Avx2>(columns, n) };
    }
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of this set exists only where the CPU reported its features.
    unsafe { run(bitmaps, columns, n) }
}
