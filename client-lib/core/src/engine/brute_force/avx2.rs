//! Comparison with AVX2: 8 columns a compare.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;
use std::ops::Range;

use super::bitmaps::{BUCKETS, Bitmaps, BucketRange};
use super::candidates::Candidates;
use super::corners::{Corners, limits};
use super::kernel::{Columns, Kernel};
use super::quantiles::{Borders, LEVELS};
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

    #[inline(always)]
    unsafe fn buckets(keys: &[i32; WORD_COLUMNS], borders: &Borders, out: &mut [u8; WORD_COLUMNS]) {
        // SAFETY: the caller vouches for AVX2.
        unsafe { buckets(keys, borders, out) }
    }

    #[inline(always)]
    unsafe fn string_words(
        buckets: &[u8; WORD_COLUMNS],
        range: BucketRange,
        strings: &mut [u64],
        word: usize,
    ) {
        // SAFETY: the caller vouches for AVX2.
        unsafe { string_words(buckets, range, strings, word) }
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

/// A step down the tree of borders is a shuffle and a comparison, 8 keys at a time; the last two
/// levels fill two and four registers, from which the node's upper bits choose.
#[inline]
#[target_feature(enable = "avx2")]
fn buckets(keys: &[i32; WORD_COLUMNS], borders: &Borders, out: &mut [u8; WORD_COLUMNS]) {
    const { assert!(LEVELS == 6, "four levels of one register, one of two, one of four") };
    let tree = borders.tree();
    let levels = [load(tree, 0), load(tree, 1), load(tree, 3), load(tree, 7)];
    let fifth = [load(tree, 15), load(tree, 23)];
    let sixth = [load(tree, 31), load(tree, 39), load(tree, 47), load(tree, 55)];
    let down = |node: __m256i, border: __m256i, key: __m256i| {
        // 2·node + 1, less 1 where the border is above the key.
        let right = _mm256_sub_epi32(_mm256_add_epi32(node, node), _mm256_set1_epi32(-1));
        _mm256_add_epi32(right, _mm256_cmpgt_epi32(border, key))
    };
    // The entries `node % 16` of two registers: bit 3 of the node, moved to the sign, chooses.
    let of_two = |node: __m256i, pair: &[__m256i]| {
        let low = _mm256_castsi256_ps(_mm256_permutevar8x32_epi32(pair[0], node));
        let high = _mm256_castsi256_ps(_mm256_permutevar8x32_epi32(pair[1], node));
        let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(node));
        _mm256_castps_si256(_mm256_blendv_ps(low, high, upper))
    };
    // The lowest byte of each lane, for each half of the register.
    let bytes = _mm256_setr_epi8(
        0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, //
        0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1,
    );
    for (eighth, out) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
        let key = load(keys, 8 * eighth);
        let mut node = _mm256_setzero_si256();
        for level in levels {
            node = down(node, _mm256_permutevar8x32_epi32(level, node), key);
        }
        node = down(node, of_two(node, &fifth), key);
        let low = _mm256_castsi256_ps(of_two(node, &sixth[..2]));
        let high = _mm256_castsi256_ps(of_two(node, &sixth[2..]));
        let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<27>(node));
        node = down(node, _mm256_castps_si256(_mm256_blendv_ps(low, high, upper)), key);
        let nothing = _mm256_cmpeq_epi32(key, _mm256_set1_epi32(KeyBox::NOTHING.min[0]));
        let packed = _mm256_shuffle_epi8(_mm256_sub_epi32(node, nothing), bytes);
        let low = _mm256_extract_epi32::<0>(packed) as u32;
        let high = _mm256_extract_epi32::<4>(packed) as u32;
        *out = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
    }
}

/// Two comparisons of 32 buckets are one word of a string.
#[inline]
#[target_feature(enable = "avx2")]
fn string_words(
    buckets: &[u8; WORD_COLUMNS],
    range: BucketRange,
    strings: &mut [u64],
    word: usize,
) {
    let half = |first: usize| {
        let half = &buckets[first..first + 32];
        // SAFETY: the slice is 32 bytes.
        unsafe { _mm256_loadu_si256(half.as_ptr().cast()) }
    };
    let halves = [half(0), half(32)];
    let stride = strings.len() / BUCKETS;
    for (q, string) in strings.chunks_exact_mut(stride).enumerate() {
        let [low, high] = halves.map(|buckets| {
            // There is only "greater", signed; buckets are at most 64, so that the sign is free.
            let held = match range {
                BucketRange::UpTo => _mm256_cmpgt_epi8(_mm256_set1_epi8(q as i8 + 1), buckets),
                BucketRange::From => _mm256_cmpgt_epi8(buckets, _mm256_set1_epi8(q as i8 - 1)),
            };
            _mm256_movemask_epi8(held) as u32
        });
        string[word] = u64::from(high) << 32 | u64::from(low);
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
