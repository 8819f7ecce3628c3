//! Hits and words with AVX2: eight strips, or the words of four hits, a step, without a branch on any
//! single one. The steps are those of [`words_avx512`](super::words_avx512).
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::StripBatch;
use super::hits::Hits;
use super::sink::WordChunk;
use super::squeeze_avx2::{LANES, lanes_first, load_at, store};
use crate::engine::{AvailableIsa, Isa};

/// Hits of a step: the lanes of a register hold two words of each.
const HITS: usize = LANES / 2;

/// Squeezes the strips with an overlap together; returns hits and pairs.
pub(super) fn collect(batch: &StripBatch, hits: &mut Hits, isa: AvailableIsa) -> (usize, u64) {
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { collect_strips(batch, hits) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn collect_strips(batch: &StripBatch, hits: &mut Hits) -> (usize, u64) {
    let (rows, starts, lanes) = batch.padded_strips();
    let (mut len, mut pairs) = (0, 0);
    for ((rows, starts), (strip, lanes)) in rows.iter().zip(starts).zip((0..).zip(lanes)) {
        let within = batch.len().saturating_sub(strip * 2 * LANES).min(2 * LANES);
        for first in [0, LANES] {
            let wanted = ((1u32 << within.saturating_sub(first).min(LANES)) - 1) as u8;
            let eight = &lanes[first..first + LANES];
            // SAFETY: 8 u16 are what is loaded.
            let bits = unsafe { _mm_loadu_si128(eight.as_ptr().cast()) };
            let bits = _mm256_cvtepu16_epi32(bits);
            let hit = wanted & !zero_lanes(bits);
            let squeeze = lanes_first(hit);
            let squeezed = |v| _mm256_permutevar8x32_epi32(v, squeeze);
            store(&mut *hits.rows, len, squeezed(load_at(rows, first)));
            store(&mut *hits.starts, len, squeezed(load_at(starts, first)));
            store(&mut *hits.bits, len, squeezed(bits));
            len += hit.count_ones() as usize;
        }
    }
    for bits in hits.bits[..len].as_chunks::<2>().0 {
        pairs += u64::from((bits[0] | bits[1] << 16).count_ones());
    }
    if len % 2 == 1 {
        pairs += u64::from(hits.bits[len - 1].count_ones());
    }
    (len, pairs)
}

/// Adds hits from number `from` on while the chunk has room; returns the next one.
pub(super) fn append(hits: &Hits, from: usize, chunk: &mut WordChunk, isa: AvailableIsa) -> usize {
    assert_eq!(isa.get(), Isa::Avx2);
    // SAFETY: an `AvailableIsa` of AVX2 exists only where the CPU reported these features.
    unsafe { append_steps(hits, from, chunk) }
}

#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn append_steps(hits: &Hits, from: usize, chunk: &mut WordChunk) -> usize {
    let twice = _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3);
    let second_of_two = _mm256_setr_epi32(0, 1, 0, 1, 0, 1, 0, 1);
    let of_second = _mm256_cmpeq_epi32(second_of_two, _mm256_set1_epi32(1));
    let mut at = from;
    while at < hits.len() && chunk.has_room() {
        let two_of = |words: &[u32]| _mm256_permutevar8x32_epi32(load_at(words, at), twice);
        let (row, start, bits) = (two_of(&*hits.rows), two_of(&*hits.starts), two_of(&*hits.bits));
        // A strip lies in one word or two: the bits of the second one are shifted out of the first.
        let block = _mm256_add_epi32(_mm256_srli_epi32::<5>(start), second_of_two);
        let shift = _mm256_and_si256(start, _mm256_set1_epi32(31));
        let first = _mm256_sllv_epi32(bits, shift);
        let second = _mm256_srlv_epi32(bits, _mm256_sub_epi32(_mm256_set1_epi32(32), shift));
        let bits = _mm256_blendv_epi8(first, second, of_second);
        let found = !zero_lanes(bits);
        let squeeze = lanes_first(found);
        let words = [row, block, bits].map(|v| _mm256_permutevar8x32_epi32(v, squeeze));
        put_words(words, found.count_ones(), chunk);
        at += HITS;
    }
    at.min(hits.len())
}

/// Adds the first `count` words, whose addresses do not fall: neighbours with the same one become
/// one word.
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
#[inline]
fn put_words([row, block, bits]: [__m256i; 3], count: u32, chunk: &mut WordChunk) {
    let last = chunk.len - 1;
    let row_before = behind(row, chunk.rows[last]);
    let block_before = behind(block, chunk.blocks[last]);
    let wanted = (1u32 << count) - 1;
    let same = _mm256_and_si256(
        _mm256_cmpeq_epi32(row, row_before),
        _mm256_cmpeq_epi32(block, block_before),
    );
    let same_set = wanted & _mm256_movemask_ps(_mm256_castsi256_ps(same)) as u32;
    if same_set & (same_set << 1) != 0 {
        // Three strips with hits in one word: rare.
        let [row, block, bits] = [row, block, bits].map(|v| lanes_of(v));
        for lane in 0..count as usize {
            chunk.push(row[lane], block[lane], bits[lane]);
        }
        return;
    }
    let bits_before = _mm256_and_si256(behind(bits, chunk.bits[last]), same);
    let bits = _mm256_or_si256(bits, bits_before);
    // The later one of two has the bits of both.
    let kept = (wanted & !(same_set >> 1)) as u8;
    let at = chunk.len - (same_set & 1) as usize;
    let squeeze = lanes_first(kept);
    store(&mut chunk.rows, at, _mm256_permutevar8x32_epi32(row, squeeze));
    store(&mut chunk.blocks, at, _mm256_permutevar8x32_epi32(block, squeeze));
    store(&mut chunk.bits, at, _mm256_permutevar8x32_epi32(bits, squeeze));
    chunk.len = at + kept.count_ones() as usize;
}

/// Every lane one place further, behind `first`.
#[target_feature(enable = "avx2")]
#[inline]
fn behind(v: __m256i, first: u32) -> __m256i {
    let moved = _mm256_permutevar8x32_epi32(v, _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6));
    _mm256_blend_epi32::<1>(moved, _mm256_set1_epi32(first as i32))
}

#[target_feature(enable = "avx2")]
#[inline]
fn zero_lanes(v: __m256i) -> u8 {
    let zero = _mm256_cmpeq_epi32(v, _mm256_setzero_si256());
    _mm256_movemask_ps(_mm256_castsi256_ps(zero)) as u8
}

#[target_feature(enable = "avx2")]
#[inline]
fn lanes_of(register: __m256i) -> [u32; LANES] {
    let mut words = [0; LANES];
    store(&mut words, 0, register);
    words
}
