//! Comparison with AVX2: 8 columns a compare.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;
use std::ops::Range;

use super::kernel::{self, Columns, Kernel};
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

/// [`kernel::compare_rows`] with AVX2.
pub(super) fn compare_rows(
    columns: &ColumnWords<'_>,
    rows: Range<usize>,
    n: usize,
    found: &mut WordList,
    isa: AvailableIsa,
) -> u64 {
    #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
    fn run(columns: &ColumnWords<'_>, rows: Range<usize>, n: usize, found: &mut WordList) -> u64 {
        // SAFETY: this function is compiled for the kernel's features.
        unsafe { kernel::compare_rows::<Avx2>(columns, rows, n, found) }
    }
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { run(columns, rows, n, found) }
}
