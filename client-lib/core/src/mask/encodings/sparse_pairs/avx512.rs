//! Sixteen words at a time with AVX-512.
//!
//! Where no word of a step has more than one bit, the words are the pairs. Where none has more than
//! two, four or eight, each word is spread over as many lanes, which hold its lowest bit, its second,
//! and so on; empty lanes are then squeezed out. Words with more bits go one by one, as columns of
//! which those without a bit are squeezed out. There is no branch on any single bit.
#![allow(unsafe_code)]
// Thirty intrinsics by name would not help a reader.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::super::sparse_words::{SparseWord, SparseWords};
use super::SparsePairs;
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::{PairWriter, WORD_PAIRS};
use crate::units::BoxCount;

/// Words of a step: the lanes of a register.
const STEP: usize = 16;

/// Room of a step whose words are spread over lanes. Those with more bits see to it themselves.
const STEP_ROOM: usize = STEP * 8;

/// [`by_word::write`](super::by_word::write) with AVX-512.
#[inline]
pub(super) fn write(
    pairs: &mut SparsePairs<'_>,
    writer: &mut PairWriter,
    isa: AvailableIsa,
) -> bool {
    assert_eq!(isa.get(), Isa::Avx512, "kernel and instruction set belong together");
    // SAFETY: `isa` is only made where the machine has these features.
    let rest = unsafe { run(pairs, writer) };
    rest.map(|rest| pairs.words = rest).is_some()
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn run<'a>(pairs: &SparsePairs<'a>, writer: &mut PairWriter) -> Option<SparseWords<'a>> {
    pairs.words.split_first()?;
    let mut words = pairs.words.clone();
    while writer.has_room_for(STEP_ROOM) {
        match words.split_first_chunk::<STEP>() {
            Some((step, rest)) if put_step(pairs.n, step, writer) => words = rest,
            _ => {
                let Some(rest) = put_singly(pairs.n, &words, writer) else { break };
                words = rest;
            }
        }
    }
    pairs.name_boxes(writer);
    Some(words)
}

/// Up to [`STEP`] words one by one. The words left over, or `None` if there was none.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
fn put_singly<'a>(
    n: BoxCount,
    words: &SparseWords<'a>,
    writer: &mut PairWriter,
) -> Option<SparseWords<'a>> {
    let (word, mut rest) = words.split_first()?;
    put_columns(n, word, writer);
    for _ in 1..STEP {
        match rest.split_first() {
            Some((word, after)) if writer.has_room_for(WORD_PAIRS) => {
                put_columns(n, word, writer);
                rest = after;
            }
            _ => break,
        }
    }
    Some(rest)
}

/// One word: 32 columns, less those without a bit.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_columns(n: BoxCount, word: SparseWord, writer: &mut PairWriter) {
    // Of a block behind the last column that there can be no bit is a pair.
    let bits = if word.block < 1 << 27 { word.bits } else { 0 };
    let row = _mm512_set1_epi32(word.row as i32);
    let n = _mm512_set1_epi32(n.get() as i32);
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    for half in [0, 16] {
        let first = _mm512_set1_epi32((word.block << 5 | half) as i32);
        let column = _mm512_add_epi32(first, lanes);
        put_pairs(n, row, column, (bits >> half) as __mmask16, writer);
    }
}

/// Sixteen words, or none and false if one of them has more than eight bits.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_step(n: BoxCount, words: [&[u32; STEP]; 3], writer: &mut PairWriter) -> bool {
    // SAFETY: each array holds the 16 words of a register.
    let [row, block, bits] = words.map(|w| unsafe { _mm512_loadu_si512(w.as_ptr().cast()) });
    // Blocks behind the last column that there can be would wrap around to other columns.
    let in_range = _mm512_cmplt_epu32_mask(block, _mm512_set1_epi32(1 << 27));
    let first = _mm512_maskz_mov_epi32(in_range, bits);
    // The exponent of an f32 counts from 127; see `put_lanes`.
    let base = _mm512_sub_epi32(_mm512_slli_epi32::<5>(block), _mm512_set1_epi32(127));
    let n = _mm512_set1_epi32(n.get() as i32);

    let second = without_lowest(first);
    if _mm512_test_epi32_mask(second, second) == 0 {
        put_lanes(n, row, base, first, writer);
        return true;
    }
    let third = without_lowest(second);
    if _mm512_test_epi32_mask(third, third) == 0 {
        put_twos(n, row, base, [first, second], writer);
        return true;
    }
    let fourth = without_lowest(third);
    let fifth = without_lowest(fourth);
    if _mm512_test_epi32_mask(fifth, fifth) == 0 {
        put_fours(n, row, base, [first, second, third, fourth], writer);
        return true;
    }
    let sixth = without_lowest(fifth);
    let seventh = without_lowest(sixth);
    let eighth = without_lowest(seventh);
    let ninth = without_lowest(eighth);
    if _mm512_test_epi32_mask(ninth, ninth) != 0 {
        return false;
    }
    let fours = [[first, second, third, fourth], [fifth, sixth, seventh, eighth]];
    put_eights(n, row, base, fours, writer);
    true
}

/// Sixteen words of at most two bits, eight words a register.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_twos(n: __m512i, row: __m512i, base: __m512i, bits: [__m512i; 2], writer: &mut PairWriter) {
    // Unpacking works within the quarters of a register: quarter q gets words 2q, 2q + 1 for the
    // first register and 8 + 2q, 9 + 2q for the second.
    let slots = _mm512_setr_epi32(0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15);
    let slot = |v| _mm512_permutexvar_epi32(slots, v);
    let (row, base, first, second) = (slot(row), slot(base), slot(bits[0]), slot(bits[1]));
    let low = |a, b| _mm512_unpacklo_epi32(a, b);
    let high = |a, b| _mm512_unpackhi_epi32(a, b);
    put_lanes(n, low(row, row), low(base, base), low(first, second), writer);
    put_lanes(n, high(row, row), high(base, base), high(first, second), writer);
}

/// Sixteen words of at most four bits, four words a register.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_fours(n: __m512i, row: __m512i, base: __m512i, bits: [__m512i; 4], writer: &mut PairWriter) {
    let (row, base) = (dealt_to_quarters(row), dealt_to_quarters(base));
    let bits = quarters(bits);
    macro_rules! put_register {
        ($copies:literal, $bits:expr) => {
            put_lanes(
                n,
                _mm512_shuffle_epi32::<$copies>(row),
                _mm512_shuffle_epi32::<$copies>(base),
                $bits,
                writer,
            );
        };
    }
    put_register!(0b00_00_00_00, bits[0]);
    put_register!(0b01_01_01_01, bits[1]);
    put_register!(0b10_10_10_10, bits[2]);
    put_register!(0b11_11_11_11, bits[3]);
}

/// Quarter q of a register gets words q, 4 + q, 8 + q, 12 + q.
#[target_feature(enable = "avx512f")]
#[inline]
fn dealt_to_quarters(v: __m512i) -> __m512i {
    // Unpacking works within quarters.
    let slots = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    _mm512_permutexvar_epi32(slots, v)
}

/// Four bits of each word: quarter q of register i are those of word 4i + q.
#[target_feature(enable = "avx512f")]
#[inline]
fn quarters(bits: [__m512i; 4]) -> [__m512i; 4] {
    let [first, second, third, fourth] = bits.map(|b| dealt_to_quarters(b));
    let low = (_mm512_unpacklo_epi32(first, second), _mm512_unpacklo_epi32(third, fourth));
    let high = (_mm512_unpackhi_epi32(first, second), _mm512_unpackhi_epi32(third, fourth));
    [
        _mm512_unpacklo_epi64(low.0, low.1),
        _mm512_unpackhi_epi64(low.0, low.1),
        _mm512_unpacklo_epi64(high.0, high.1),
        _mm512_unpackhi_epi64(high.0, high.1),
    ]
}

/// Sixteen words of at most eight bits, two words a register.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_eights(
    n: __m512i,
    row: __m512i,
    base: __m512i,
    [low, high]: [[__m512i; 4]; 2],
    writer: &mut PairWriter,
) {
    let (low, high) = (quarters(low), quarters(high));
    // Quarters 2h and 2h + 1 of both, in turn.
    let halves = [
        _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11),
        _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15),
    ];
    let mut words = _mm512_setr_epi32(0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1);
    for (low, high) in low.into_iter().zip(high) {
        for half in halves {
            let bits = _mm512_permutex2var_epi64(low, half, high);
            let row = _mm512_permutexvar_epi32(words, row);
            let base = _mm512_permutexvar_epi32(words, base);
            put_lanes(n, row, base, bits, writer);
            words = _mm512_add_epi32(words, _mm512_set1_epi32(2));
        }
    }
}

/// Every lane without its lowest bit.
#[target_feature(enable = "avx512f")]
#[inline]
fn without_lowest(bits: __m512i) -> __m512i {
    _mm512_and_si512(bits, _mm512_add_epi32(bits, _mm512_set1_epi32(-1)))
}

/// The pair of the lowest bit of each lane that has one: (row, base + 127 + bit).
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_lanes(n: __m512i, row: __m512i, base: __m512i, bits: __m512i, writer: &mut PairWriter) {
    // The number of a single bit is the exponent of its f32.
    let lowest = _mm512_and_si512(bits, _mm512_sub_epi32(_mm512_setzero_si512(), bits));
    let exponent = _mm512_srli_epi32::<23>(_mm512_castps_si512(_mm512_cvtepu32_ps(lowest)));
    let column = _mm512_add_epi32(base, exponent);
    let set = _mm512_test_epi32_mask(bits, bits);
    put_pairs(n, row, column, set, writer);
}

/// The pairs (row, column) of the lanes of `set`, less strays.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn put_pairs(n: __m512i, row: __m512i, column: __m512i, set: __mmask16, writer: &mut PairWriter) {
    let after_row = _mm512_mask_cmplt_epu32_mask(set, row, column);
    let pairs = _mm512_mask_cmplt_epu32_mask(after_row, column, n);
    let row = _mm512_maskz_compress_epi32(pairs, row);
    let column = _mm512_maskz_compress_epi32(pairs, column);
    let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    let high = _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
    let halves =
        [_mm512_permutex2var_epi32(row, low, column), _mm512_permutex2var_epi32(row, high, column)];
    // SAFETY: both types are 128 bytes without padding, and every bit pattern is one of both.
    let sixteen: [[u32; 2]; STEP] = unsafe { std::mem::transmute(halves) };
    writer.put_first_of(pairs.count_ones() as usize, sixteen);
}
