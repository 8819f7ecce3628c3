//! Blocks with AVX-512: 16 columns of a strip in registers, one row after the other; and the words of
//! a row at a time.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::STRIP_COLUMNS;
use super::block::{BLOCK_LANES, RowBlock};
use super::ordered::KeyArrays;
use super::sink::WordChunk;
use crate::engine::{AvailableIsa, Isa};

const LANES_OF_HALF: usize = BLOCK_LANES / 2;

/// Tests the rows against their strips; see [`RowBlock::test`]. Returns the columns compared.
pub(super) fn test(keys: &KeyArrays<'_>, block: &mut RowBlock, isa: AvailableIsa) -> u64 {
    assert_eq!(isa.get(), Isa::Avx512);
    let len = keys.iter().map(|k| k.len()).min().unwrap_or(0);
    assert!(block.first_row as usize + BLOCK_LANES <= len);
    // All lanes are looked at, so that the compiler makes registers of them and no loop.
    let (mut last_start, strip_count) = (0, block.strip_count);
    for (i, start) in block.starts[..BLOCK_LANES].iter().enumerate() {
        last_start = last_start.max(if i < strip_count { *start } else { 0 });
    }
    assert!(strip_count <= BLOCK_LANES && last_start as usize + STRIP_COLUMNS <= len);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features, and 16
    // rows, and 16 columns of each strip, were seen to be in the arrays.
    unsafe { test_checked(keys, block) }
}

/// # Safety
/// 16 rows from the first one, and 16 columns from the start of each strip, must lie in all six
/// arrays.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
unsafe fn test_checked(keys: &KeyArrays<'_>, block: &mut RowBlock) -> u64 {
    let keys = keys.map(<[i32]>::as_ptr);
    let RowBlock { first_row, row_count, starts, lanes, rows, strip_count, overlaps } = block;
    let (first_row, row_count) = (*first_row as usize, *row_count);
    overlaps[..row_count].fill([0; BLOCK_LANES]);
    let mut compared = 0;
    for strip in 0..*strip_count {
        let (start, lanes) = (starts[strip] as usize, lanes[strip]);
        // SAFETY: the caller vouches for 16 keys from `start`.
        let columns = keys.map(|key| unsafe { _mm512_loadu_si512(key.add(start).cast()) });
        let overlaps_of = |i: usize, lanes: u16| {
            let row = first_row + i % BLOCK_LANES;
            // SAFETY: the caller vouches for 16 rows from the first one.
            let of_row = |axis: usize| unsafe { _mm512_set1_epi32(*keys[axis].add(row)) };
            // As in `super::avx512`.
            (0..3).fold(lanes, |hit, axis| {
                let low = _mm512_max_epi32(columns[axis], of_row(axis));
                let high = _mm512_min_epi32(columns[3 + axis], of_row(3 + axis));
                _mm512_mask_cmple_epi32_mask(hit, low, high)
            })
        };
        if start <= first_row {
            // The strip of the rows themselves: each looks at those after it.
            let mut after = (u16::MAX - 1) << (first_row % STRIP_COLUMNS);
            for i in 0..row_count {
                overlaps[i][strip] = overlaps_of(i, lanes & after);
                compared += u64::from((lanes & after).count_ones());
                after <<= 1;
            }
        } else {
            compared += u64::from(lanes.count_ones() * rows[strip].count_ones());
            let mut rest = rows[strip];
            while rest != 0 {
                let i = rest.trailing_zeros() as usize % BLOCK_LANES;
                overlaps[i][strip] = overlaps_of(i, lanes);
                rest &= rest - 1;
            }
        }
    }
    compared
}

/// Adds the words of rows; see [`RowBlock::append`].
pub(super) fn append(
    block: &RowBlock,
    from: usize,
    chunk: &mut WordChunk,
    isa: AvailableIsa,
) -> (usize, u64) {
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { append_rows(block, from, chunk) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn append_rows(block: &RowBlock, from: usize, chunk: &mut WordChunk) -> (usize, u64) {
    // SAFETY: 20 u32 are more than the 64 bytes of a register.
    let starts = unsafe { _mm512_loadu_si512(block.starts.as_ptr().cast()) };
    let blocks = _mm512_srli_epi32::<5>(starts);
    let shift = _mm512_and_si512(starts, _mm512_set1_epi32(31));
    // A strip and the next one may be the halves of one word: the first of the two gets both.
    let next_blocks = _mm512_alignr_epi32::<1>(blocks, blocks);
    let but_last = ((1u32 << block.strip_count) >> 1).saturating_sub(1) as __mmask16;
    let with_next = _mm512_mask_cmpeq_epi32_mask(but_last, blocks, next_blocks);
    let words_at = !(with_next << 1);
    // Stores that are not on a border take twice as long, and whole registers seldom are.
    let few = block.strip_count <= LANES_OF_HALF;
    let (mut row, mut pairs) = (from, 0);
    while row < block.row_count && chunk.has_room() {
        let overlaps = &block.overlaps[row];
        let quarters: [u64; 4] = bytemuck::cast(*overlaps);
        pairs += quarters.iter().map(|q| u64::from(q.count_ones())).sum::<u64>();
        // SAFETY: 16 u16 are 32 bytes.
        let overlaps = unsafe { _mm256_loadu_si256(overlaps.as_ptr().cast()) };
        let halves = _mm512_sllv_epi32(_mm512_cvtepu16_epi32(overlaps), shift);
        let next_halves = _mm512_alignr_epi32::<1>(halves, halves);
        let words = _mm512_mask_or_epi32(halves, with_next, halves, next_halves);
        let found = _mm512_mask_test_epi32_mask(words_at, words, words);
        let at = chunk.len;
        let position = _mm512_set1_epi32((block.first_row + row as u32) as i32);
        let blocks = _mm512_maskz_compress_epi32(found, blocks);
        let words = _mm512_maskz_compress_epi32(found, words);
        if few {
            store_half(&mut chunk.rows, at, position);
            store_half(&mut chunk.blocks, at, blocks);
            store_half(&mut chunk.bits, at, words);
        } else {
            store(&mut chunk.rows, at, position);
            store(&mut chunk.blocks, at, blocks);
            store(&mut chunk.bits, at, words);
        }
        chunk.len += found.count_ones() as usize;
        row += 1;
    }
    (row, pairs)
}

#[target_feature(enable = "avx512f")]
#[inline]
fn store(words: &mut [u32], at: usize, register: __m512i) {
    let words = &mut words[at..at + BLOCK_LANES];
    // SAFETY: 16 u32, exclusively borrowed, are the 64 bytes of a register.
    unsafe { _mm512_storeu_si512(words.as_mut_ptr().cast(), register) }
}

/// The first eight lanes.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn store_half(words: &mut [u32], at: usize, register: __m512i) {
    let words = &mut words[at..at + LANES_OF_HALF];
    // SAFETY: 8 u32, exclusively borrowed, are the 32 bytes of half a register.
    unsafe { _mm256_storeu_si256(words.as_mut_ptr().cast(), _mm512_castsi512_si256(register)) }
}
