//! Hits and words with AVX-512: 16 strips, or the words of 8 hits, a step, without a branch on any
//! single one.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::StripBatch;
use super::hits::Hits;
use super::sink::WordChunk;
use crate::engine::{AvailableIsa, Isa};

const LANES: usize = 16;

/// Squeezes the strips with an overlap together; returns hits and pairs.
pub(super) fn collect(batch: &StripBatch, hits: &mut Hits, isa: AvailableIsa) -> (usize, u64) {
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { collect_strips(batch, hits) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn collect_strips(batch: &StripBatch, hits: &mut Hits) -> (usize, u64) {
    let (rows, starts, lanes) = batch.padded_strips();
    let (mut len, mut pairs) = (0, 0);
    for ((rows, starts), (strip, lanes)) in rows.iter().zip(starts).zip((0..).zip(lanes)) {
        let within = batch.len().saturating_sub(strip * LANES).min(LANES);
        let wanted = ((1u32 << within) - 1) as __mmask16;
        // SAFETY: `lanes` is 16 u16, 32 bytes.
        let lanes = unsafe { _mm256_loadu_si256(lanes.as_ptr().cast()) };
        let lanes = _mm512_maskz_cvtepu16_epi32(wanted, lanes);
        let hit = _mm512_test_epi32_mask(lanes, lanes);
        store(&mut *hits.rows, len, _mm512_maskz_compress_epi32(hit, load(rows)));
        store(&mut *hits.starts, len, _mm512_maskz_compress_epi32(hit, load(starts)));
        store(&mut *hits.bits, len, _mm512_maskz_compress_epi32(hit, lanes));
        len += hit.count_ones() as usize;
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
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { append_steps(hits, from, chunk) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn append_steps(hits: &Hits, from: usize, chunk: &mut WordChunk) -> usize {
    let twice = [
        _mm512_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7),
        _mm512_setr_epi32(8, 8, 9, 9, 10, 10, 11, 11, 12, 12, 13, 13, 14, 14, 15, 15),
    ];
    let in_turn = [
        _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23),
        _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31),
    ];
    let second_of_two = _mm512_setr_epi32(0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1);
    let mut at = from;
    while at < hits.len() && chunk.has_room() {
        let row = load_at(&*hits.rows, at);
        let start = load_at(&*hits.starts, at);
        let bits = load_at(&*hits.bits, at);
        // A strip lies in one word or two: the bits of the second one are shifted out of the first.
        let block = _mm512_srli_epi32::<5>(start);
        let shift = _mm512_and_si512(start, _mm512_set1_epi32(31));
        let first = _mm512_sllv_epi32(bits, shift);
        let second = _mm512_srlv_epi32(bits, _mm512_sub_epi32(_mm512_set1_epi32(32), shift));
        for half in 0..2 {
            let row = _mm512_permutexvar_epi32(twice[half], row);
            let block = _mm512_permutexvar_epi32(twice[half], block);
            let block = _mm512_add_epi32(block, second_of_two);
            let bits = _mm512_permutex2var_epi32(first, in_turn[half], second);
            let found = _mm512_test_epi32_mask(bits, bits);
            let words = [row, block, bits].map(|v| _mm512_maskz_compress_epi32(found, v));
            put_words(words, found.count_ones(), chunk);
        }
        at += LANES;
    }
    at.min(hits.len())
}

/// Adds the first `count` words, whose addresses do not fall: neighbours with the same one become
/// one word.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_words([row, block, bits]: [__m512i; 3], count: u32, chunk: &mut WordChunk) {
    let last = chunk.len - 1;
    let of_last = |array: &[u32]| _mm512_set1_epi32(array[last] as i32);
    let row_before = _mm512_alignr_epi32::<15>(row, of_last(&chunk.rows));
    let block_before = _mm512_alignr_epi32::<15>(block, of_last(&chunk.blocks));
    let wanted = ((1u32 << count) - 1) as __mmask16;
    let same = _mm512_mask_cmpeq_epi32_mask(wanted, row, row_before);
    let same = _mm512_mask_cmpeq_epi32_mask(same, block, block_before);
    if same & (same << 1) != 0 {
        // Three strips with hits in one word: rare.
        let [row, block, bits] = [row, block, bits].map(|v| lanes_of(v));
        for lane in 0..count as usize {
            chunk.push(row[lane], block[lane], bits[lane]);
        }
        return;
    }
    let bits_before = _mm512_alignr_epi32::<15>(bits, of_last(&chunk.bits));
    let bits = _mm512_mask_or_epi32(bits, same, bits, bits_before);
    // The later one of two has the bits of both.
    let kept = wanted & !(same >> 1);
    let at = chunk.len - usize::from(same & 1);
    store(&mut chunk.rows, at, _mm512_maskz_compress_epi32(kept, row));
    store(&mut chunk.blocks, at, _mm512_maskz_compress_epi32(kept, block));
    store(&mut chunk.bits, at, _mm512_maskz_compress_epi32(kept, bits));
    chunk.len = at + kept.count_ones() as usize;
}

#[target_feature(enable = "avx512f")]
#[inline]
fn load(words: &[u32; LANES]) -> __m512i {
    // SAFETY: 16 u32 are the 64 bytes of a register.
    unsafe { _mm512_loadu_si512(words.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f")]
#[inline]
pub(super) fn load_at(words: &[u32], at: usize) -> __m512i {
    let words = &words[at..at + LANES];
    // SAFETY: 16 u32 are the 64 bytes of a register.
    unsafe { _mm512_loadu_si512(words.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f")]
#[inline]
pub(super) fn store(words: &mut [u32], at: usize, register: __m512i) {
    let words = &mut words[at..at + LANES];
    // SAFETY: 16 u32, exclusively borrowed, are the 64 bytes of a register.
    unsafe { _mm512_storeu_si512(words.as_mut_ptr().cast(), register) }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn lanes_of(register: __m512i) -> [u32; LANES] {
    let mut words = [0; LANES];
    store(&mut words, 0, register);
    words
}
