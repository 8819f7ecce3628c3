//! Sifting words with AVX-512: 16 words a step by their kinds, then 32 columns a word by owner and world,
//! without a branch on any single word.
#![allow(unsafe_code)]
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::laid::{BLOCK, Laid};
use crate::engine::{AvailableIsa, Isa};
use crate::filters::{Owner, World};

const LANES: usize = 16;

/// Whether all positions and places fit the signed 32 bits that the kernel gathers by.
pub(super) fn takes(laid: &Laid) -> bool {
    i32::try_from(laid.kinds.len().max(laid.columns.len())).is_ok()
}

/// As [`Laid::sift`].
pub(super) fn sift(laid: &Laid, words: [&mut [u32]; 3], isa: AvailableIsa) -> (usize, u64) {
    assert_eq!(isa.get(), Isa::Avx512);
    // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
    unsafe { sift_both(laid, words) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn sift_both(laid: &Laid, [rows, blocks, bits]: [&mut [u32]; 3]) -> (usize, u64) {
    let before = pair_count(bits);
    let mut kept = sift_kinds(laid, [&mut *rows, &mut *blocks, &mut *bits]);
    if !(laid.owners.is_empty() && laid.worlds.is_empty()) {
        kept = sift_pairs(laid, [&mut rows[..kept], &mut blocks[..kept], &mut bits[..kept]]);
    }
    (kept, before - pair_count(&bits[..kept]))
}

#[target_feature(enable = "popcnt")]
fn pair_count(words: &[u32]) -> u64 {
    // A plain loop: closures are not compiled for the instruction.
    let (twos, rest) = words.as_chunks::<2>();
    let mut count = 0;
    for [a, b] in twos {
        count += u64::from((u64::from(*a) | u64::from(*b) << 32).count_ones());
    }
    for word in rest {
        count += u64::from(word.count_ones());
    }
    count
}

/// Keeps the columns that the row's kind meets.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn sift_kinds(laid: &Laid, [rows, blocks, bits]: [&mut [u32]; 3]) -> usize {
    let Laid { kinds, columns, kind_count, .. } = laid;
    let row_end = _mm512_set1_epi32(kinds.len().saturating_sub(3) as i32);
    let block_end = _mm512_set1_epi32(columns.len().checked_div(*kind_count).unwrap_or(0) as i32);
    let kind_count = _mm512_set1_epi32(*kind_count as i32);
    let (len, mut kept) = (rows.len().min(blocks.len()).min(bits.len()), 0);
    for at in (0..len).step_by(LANES) {
        let lanes = lanes(len - at);
        let word = [&*rows, &*blocks, &*bits].map(|words| {
            // SAFETY: the lanes that are read are below `len`.
            unsafe { _mm512_maskz_loadu_epi32(lanes, words.as_ptr().add(at).cast()) }
        });
        // A word that no frame of so many boxes has, has no bits.
        let within = _mm512_mask_cmplt_epu32_mask(lanes, word[0], row_end)
            & _mm512_mask_cmplt_epu32_mask(lanes, word[1], block_end);
        let zero = _mm512_setzero_si512();
        // SAFETY: the lanes that are gathered name a position, behind which three bytes are.
        let kind = unsafe {
            _mm512_mask_i32gather_epi32::<1>(zero, within, word[0], kinds.as_ptr().cast())
        };
        let kind = _mm512_and_si512(kind, _mm512_set1_epi32(0xFF));
        let slot = _mm512_add_epi32(_mm512_mullo_epi32(word[1], kind_count), kind);
        // SAFETY: the lanes that are gathered name a block and one of its kinds.
        let met = unsafe {
            _mm512_mask_i32gather_epi32::<4>(zero, within, slot, columns.as_ptr().cast())
        };
        let passing = _mm512_and_si512(word[2], met);
        let stay = _mm512_mask_test_epi32_mask(lanes, passing, passing);
        store(rows, kept, stay, word[0]);
        store(blocks, kept, stay, word[1]);
        store(bits, kept, stay, passing);
        kept += stay.count_ones() as usize;
    }
    kept
}

/// Keeps the columns of another owner and of a world that meets the row's.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn sift_pairs(laid: &Laid, [rows, blocks, bits]: [&mut [u32]; 3]) -> usize {
    let Laid { owners, worlds, .. } = laid;
    let all = _mm512_set1_epi32(World::ALL.0);
    let mut kept = 0;
    for at in 0..bits.len() {
        let (row, block) = (rows[at], blocks[at]);
        let columns = BLOCK * block as usize..BLOCK * (block as usize + 1);
        let mut passing = bits[at];
        if !owners.is_empty() {
            let owner = owners[row as usize];
            let [low, high] = halves(bytemuck::cast_slice(&owners[columns.clone()]));
            let of_row = _mm512_set1_epi32(owner.cast_signed());
            let same =
                both(_mm512_cmpeq_epi32_mask(low, of_row), _mm512_cmpeq_epi32_mask(high, of_row));
            passing &= !same | 0u32.wrapping_sub(u32::from(owner == Owner::NONE.0));
        }
        if !worlds.is_empty() {
            let world = worlds[row as usize];
            let [low, high] = halves(&worlds[columns]);
            let of_row = _mm512_set1_epi32(world);
            let same = both(
                _mm512_cmpeq_epi32_mask(low, of_row) | _mm512_cmpeq_epi32_mask(low, all),
                _mm512_cmpeq_epi32_mask(high, of_row) | _mm512_cmpeq_epi32_mask(high, all),
            );
            passing &= same | 0u32.wrapping_sub(u32::from(world == World::ALL.0));
        }
        (rows[kept], blocks[kept], bits[kept]) = (row, block, passing);
        kept += usize::from(passing != 0);
    }
    kept
}

/// The first lanes, all where there are enough.
fn lanes(len: usize) -> __mmask16 {
    ((1u32 << len.min(LANES)) - 1) as __mmask16
}

/// Bits of the first and the last 16 columns.
fn both(low: __mmask16, high: __mmask16) -> u32 {
    u32::from(low) | u32::from(high) << LANES
}

#[target_feature(enable = "avx512f")]
#[inline]
fn halves(columns: &[i32]) -> [__m512i; 2] {
    let (halves, _) = columns.as_chunks::<LANES>();
    // SAFETY: 16 i32 are the 64 bytes of a register.
    [0, 1].map(|half: usize| unsafe { _mm512_loadu_si512(halves[half].as_ptr().cast()) })
}

/// Stores the lanes that stay, one after the other. No lane before them has yet to be read.
#[target_feature(enable = "avx512f")]
#[inline]
fn store(words: &mut [u32], at: usize, stay: __mmask16, register: __m512i) {
    let (count, packed) = (stay.count_ones() as usize, _mm512_maskz_compress_epi32(stay, register));
    let words = &mut words[at..at + count];
    // SAFETY: the lanes that are written lie in `words`, which is exclusively borrowed.
    unsafe { _mm512_mask_storeu_epi32(words.as_mut_ptr().cast(), lanes(count), packed) }
}
