//! Comparison with AVX2: 8 columns a compare.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;
use std::ops::Range;

use super::bitmaps::Bitmaps;
use super::candidates::Candidates;
use super::corners::{Corners, limits};
use super::kernel::{Columns, Kernel};
use super::search::{self, Scene};
use super::words::WordList;
use crate::aabb::KeyBox;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};
use crate::engine::{AvailableIsa, Isa};

/// The kernel. Its methods are one line each: code that is to be compiled for AVX2 stands in
/// `target_feature` functions, whose closures and helpers inherit the feature.
struct Avx2;

impl Kernel for Avx2 {
    type Row = [__m256i; 6];

    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> Self::Row {
        // SAFETY: the caller vouches for AVX2.
        unsafe { spread(key) }
    }

    #[inline(always)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64 {
        // SAFETY: the caller vouches for AVX2.
        unsafe { compare(row, columns) }
    }

    #[inline(always)]
    unsafe fn hits(row: &Corners, columns: &[Corners; WORD_COLUMNS], candidates: u64) -> u64 {
        // SAFETY: the caller vouches for AVX2.
        unsafe { hits(row, columns, candidates) }
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn spread(key: &KeyBox) -> [__m256i; 6] {
    let [x, y, z] = key.min;
    let [u, v, w] = key.max;
    [x, y, z, u, v, w].map(|k| _mm256_set1_epi32(k))
}

/// 8 keys of an array.
#[inline]
#[target_feature(enable = "avx2")]
fn load(keys: &[i32], first: usize) -> __m256i {
    let keys = &keys[first..first + 8];
    // SAFETY: the slice is 8 i32, 32 bytes.
    unsafe { _mm256_loadu_si256(keys.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn compare(row: &[__m256i; 6], columns: &Columns<'_>) -> u64 {
    let mut bits = 0;
    for eighth in 0..8 {
        // There is only "greater": gather what keeps two boxes apart.
        let mut apart = _mm256_setzero_si256();
        for axis in 0..3 {
            let below = _mm256_cmpgt_epi32(row[axis], load(columns[3 + axis], 8 * eighth));
            let above = _mm256_cmpgt_epi32(load(columns[axis], 8 * eighth), row[3 + axis]);
            apart = _mm256_or_si256(apart, _mm256_or_si256(below, above));
        }
        let apart = _mm256_movemask_ps(_mm256_castsi256_ps(apart)) as u8;
        bits |= u64::from(!apart) << (8 * eighth);
    }
    bits
}

/// A pair is one comparison: all eight lanes of the row's limits against the column's corners.
#[inline]
#[target_feature(enable = "avx2,bmi1")]
pub(super) fn hits(row: &Corners, columns: &[Corners; WORD_COLUMNS], candidates: u64) -> u64 {
    let limits = load(&limits(row), 0);
    let (mut hits, mut rest) = (0, candidates);
    while rest != 0 {
        let column = rest.trailing_zeros();
        let missed = _mm256_cmpgt_epi32(limits, load(&columns[column as usize], 0));
        hits |= u64::from(_mm256_testz_si256(missed, missed) != 0) << column;
        rest &= rest - 1;
    }
    hits
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
