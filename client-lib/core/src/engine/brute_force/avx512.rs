//! AVX-512: 16 columns a comparison, whose answer is 16 mask bits as they are; 512 columns an AND.
#![allow(unsafe_code)]
// Forty intrinsics by name would tell a reader nothing.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;
use std::ops::Range;

use super::avx2;
use super::bitmaps::{BUCKETS, Bitmaps, BucketRange, LINE_WORDS, RowStrings};
use super::candidates::{Candidates, address};
use super::corners::Corners;
use super::kernel::{Columns, Kernel, after_row, first_word};
use super::quantiles::{Borders, LEVELS};
use super::search::{self, Scene};
use super::words::WordList;
use crate::aabb::KeyBox;
use crate::engine::ingest::{ColumnWords, WORD_COLUMNS};
use crate::engine::{AvailableIsa, Isa};

/// The kernel. Its methods are one line each: code that is to be compiled for AVX-512 stands in
/// `target_feature` functions, whose closures and helpers inherit the feature.
struct Avx512;

impl Kernel for Avx512 {
    type Row = [__m512i; 6];

    #[inline(always)]
    unsafe fn row(key: &KeyBox) -> Self::Row {
        // SAFETY: the caller vouches for AVX-512.
        unsafe { spread(key) }
    }

    #[inline(always)]
    unsafe fn word(row: &Self::Row, columns: &Columns<'_>) -> u64 {
        // SAFETY: the caller vouches for AVX-512.
        unsafe { compare(row, columns) }
    }

    #[inline(always)]
    unsafe fn hits(row: &Corners, columns: &[Corners; WORD_COLUMNS], candidates: u64) -> u64 {
        // SAFETY: a processor with AVX-512 is only taken for one if it has AVX2 and BMI1 as well.
        unsafe { avx2::hits(row, columns, candidates) }
    }

    #[inline(always)]
    unsafe fn buckets(keys: &[i32; WORD_COLUMNS], borders: &Borders, out: &mut [u8; WORD_COLUMNS]) {
        // SAFETY: the caller vouches for AVX-512.
        unsafe { buckets(keys, borders, out) }
    }

    #[inline(always)]
    unsafe fn string_words(
        buckets: &[u8; WORD_COLUMNS],
        range: BucketRange,
        strings: &mut [u64],
        word: usize,
    ) {
        // SAFETY: the caller vouches for AVX-512.
        unsafe { string_words(buckets, range, strings, word) }
    }

    #[inline(always)]
    unsafe fn and_row(strings: &RowStrings<'_>, row: usize, candidates: &mut Candidates) {
        // SAFETY: the caller vouches for AVX-512.
        unsafe { and_row(strings, row, candidates) }
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn spread(key: &KeyBox) -> [__m512i; 6] {
    let [x, y, z] = key.min;
    let [u, v, w] = key.max;
    [x, y, z, u, v, w].map(|k| _mm512_set1_epi32(k))
}

/// 16 keys or nodes of an array.
#[inline]
#[target_feature(enable = "avx512f")]
fn load(keys: &[i32], first: usize) -> __m512i {
    let keys = &keys[first..first + 16];
    // SAFETY: the slice is 16 i32, 64 bytes.
    unsafe { _mm512_loadu_si512(keys.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn compare(row: &[__m512i; 6], columns: &Columns<'_>) -> u64 {
    let mut bits = 0;
    for quarter in 0..4 {
        let mut mask: __mmask16 = !0;
        for axis in 0..3 {
            let (min, max) =
                (load(columns[axis], 16 * quarter), load(columns[3 + axis], 16 * quarter));
            mask = _mm512_mask_cmple_epi32_mask(mask, row[axis], max);
            mask = _mm512_mask_cmple_epi32_mask(mask, min, row[3 + axis]);
        }
        bits |= u64::from(mask) << (16 * quarter);
    }
    bits
}

/// A step down the tree of borders is a shuffle and a comparison, 16 keys at a time.
#[inline]
#[target_feature(enable = "avx512f")]
fn buckets(keys: &[i32; WORD_COLUMNS], borders: &Borders, out: &mut [u8; WORD_COLUMNS]) {
    const { assert!(LEVELS == 6, "one register a level, and two for the last") };
    let tree = borders.tree();
    let levels = [load(tree, 0), load(tree, 1), load(tree, 3), load(tree, 7), load(tree, 15)];
    let (last_low, last_high) = (load(tree, 31), load(tree, 47));
    let one = _mm512_set1_epi32(1);
    let down = |node: __m512i, border: __m512i, key: __m512i| {
        let above = _mm512_cmple_epi32_mask(border, key);
        let child = _mm512_add_epi32(node, node);
        _mm512_mask_add_epi32(child, above, child, one)
    };
    for (quarter, out) in out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
        let key = load(keys, 16 * quarter);
        let mut node = _mm512_setzero_si512();
        for level in levels {
            node = down(node, _mm512_permutexvar_epi32(node, level), key);
        }
        node = down(node, _mm512_permutex2var_epi32(last_low, node, last_high), key);
        let nothing = _mm512_cmpeq_epi32_mask(key, _mm512_set1_epi32(KeyBox::NOTHING.min[0]));
        node = _mm512_mask_add_epi32(node, nothing, node, one);
        // SAFETY: `out` is 16 bytes, exclusively borrowed.
        unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), _mm512_cvtepi32_epi8(node)) };
    }
}

/// One comparison of 64 buckets is one word of a string.
#[inline]
#[target_feature(enable = "avx512f,avx512bw")]
fn string_words(
    buckets: &[u8; WORD_COLUMNS],
    range: BucketRange,
    strings: &mut [u64],
    word: usize,
) {
    // SAFETY: `buckets` is 64 bytes.
    let buckets = unsafe { _mm512_loadu_si512(buckets.as_ptr().cast()) };
    let mut border = _mm512_setzero_si512();
    let stride = strings.len() / BUCKETS;
    for string in strings.chunks_exact_mut(stride) {
        string[word] = match range {
            BucketRange::UpTo => _mm512_cmple_epu8_mask(buckets, border),
            BucketRange::From => _mm512_cmpge_epu8_mask(buckets, border),
        };
        border = _mm512_add_epi8(border, _mm512_set1_epi8(1));
    }
}

/// One line of six strings under AND.
#[inline]
#[target_feature(enable = "avx512f")]
fn and_line(strings: &RowStrings<'_>, line: usize) -> __m512i {
    let [a, b, c, d, e, f] = strings.map(|string| {
        // SAFETY: a line is 8 u64, 64 bytes.
        unsafe { _mm512_loadu_si512(string[line].as_ptr().cast()) }
    });
    let abc = _mm512_and_si512(_mm512_and_si512(a, b), c);
    _mm512_and_si512(abc, _mm512_and_si512(_mm512_and_si512(d, e), f))
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq,popcnt")]
fn and_row(strings: &RowStrings<'_>, row: usize, candidates: &mut Candidates) {
    let (first_line, first_word) = first_word(row);
    // Masked in registers: an array written word by word and read at once would stall.
    let later = _mm512_maskz_mov_epi64(0xff << first_word, and_line(strings, first_line));
    let after = _mm512_set1_epi64(after_row(row) as i64);
    let mut bits = _mm512_mask_and_epi64(later, 1 << first_word, later, after);
    for line in first_line..strings[0].len() {
        if line > first_line {
            bits = and_line(strings, line);
        }
        let kept = _mm512_test_epi64_mask(bits, bits);
        candidates.append(|out| {
            let first = _mm512_set1_epi64(address(row, line * LINE_WORDS) as i64);
            let addresses = _mm512_add_epi64(first, _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 6, 7));
            // Compressed in a register and stored whole: a compressing store is slow on some
            // processors, and the places behind are free anyway.
            let bits = _mm512_maskz_compress_epi64(kept, bits);
            let addresses = _mm512_maskz_compress_epi64(kept, addresses);
            // SAFETY: both arrays of places are 8 u64, 64 bytes, exclusively borrowed.
            unsafe {
                _mm512_storeu_si512(out.bits.as_mut_ptr().cast(), bits);
                _mm512_storeu_si512(out.addresses.as_mut_ptr().cast(), addresses);
            }
            kept.count_ones() as usize
        });
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
