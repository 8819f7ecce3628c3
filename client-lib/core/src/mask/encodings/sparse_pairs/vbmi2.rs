//! Words of a mask with an order, one by one with AVX-512 VBMI2.
//!
//! The columns of a word are 32 positions in sequence, so their boxes are two registers. The numbers
//! of its bits, squeezed together as bytes, pick up to eight boxes from these at a time: no look-up
//! goes by a single pair, and there is no branch on any single bit. What names no pair is taken
//! from 16 words at a time before.
#![allow(unsafe_code)]
// Thirty intrinsics by name would not help a reader.
#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::super::sparse_words::{SparseWord, SparseWords};
use super::SparsePairs;
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::{PairWriter, WORD_PAIRS};
use crate::units::BoxCount;

/// Words whose stray bits are taken away together: the lanes of a register.
const STEP: usize = 16;

/// Positions of an order that a second-level cache of 1 MiB does not keep beside the words: below,
/// fetching ahead takes longer than it saves.
const LARGE_ORDER: usize = 1 << 17;

/// Words from a step to those whose names are fetched meanwhile: some 100 ns, a look into memory.
const AHEAD: usize = 96;

/// Pairs of a register.
const EIGHT: usize = 8;

/// Room of a word: its pairs, and a register that is stored whole behind them.
const WORD_ROOM: usize = WORD_PAIRS + EIGHT;

/// Proof that this machine has AVX-512 with VBMI2: Ice Lake, Zen 4 and later ones.
#[derive(Clone, Copy, Debug)]
pub(in crate::mask::encodings) struct Vbmi2(());

impl Vbmi2 {
    /// The proof, where the machine has it beside AVX-512.
    pub fn new(isa: AvailableIsa) -> Option<Self> {
        let available = isa.get() == Isa::Avx512 && is_x86_feature_detected!("avx512vbmi2");
        available.then_some(Self(()))
    }
}

/// [`by_word::write`](super::by_word::write) of a mask with an order. `order` has a box for each position.
#[inline]
pub(super) fn write(
    pairs: &mut SparsePairs<'_>,
    order: &[u32],
    writer: &mut PairWriter,
    _: Vbmi2,
) -> bool {
    assert!(order.len() >= pairs.n.len(), "the view has seen a box for each position");
    // SAFETY: the proof is only made where the machine has these features.
    let rest = unsafe {
        if order.len() >= LARGE_ORDER {
            run::<true>(pairs, order, writer)
        } else {
            run::<false>(pairs, order, writer)
        }
    };
    rest.map(|rest| pairs.words = rest).is_some()
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2,popcnt,bmi1,bmi2")]
fn run<'a, const FETCH_AHEAD: bool>(
    pairs: &SparsePairs<'a>,
    order: &[u32],
    writer: &mut PairWriter,
) -> Option<SparseWords<'a>> {
    pairs.words.split_first()?;
    let mut words = pairs.words.clone();
    let mut names = Names { order, largest: _mm256_setzero_si256(), equal: 0 };
    while writer.has_room_for(WORD_ROOM)
        && let Some((step, rest)) = words.split_first_chunk::<STEP>()
    {
        if FETCH_AHEAD && let Some(blocks) = words.blocks_from::<STEP>(AHEAD) {
            fetch_names(order, blocks);
        }
        let [rows, blocks, bits] = without_strays(pairs.n, step);
        let mut done = 0;
        while done < STEP && writer.has_room_for(WORD_ROOM) {
            let word = SparseWord { row: rows[done], block: blocks[done], bits: bits[done] };
            // SAFETY: the copies have bits of columns below `n` only, and the order has that many.
            unsafe { names.put_word(word, writer) };
            done += 1;
        }
        words = if done == STEP { rest } else { words.without_first(done) };
    }
    // Fewer than a step at the end of the mask; after a full buffer there is no room for any.
    while writer.has_room_for(WORD_ROOM)
        && let Some((word, rest)) = words.split_first()
    {
        // SAFETY: as above.
        unsafe { names.put_word(word.without_strays(pairs.n), writer) };
        words = rest;
    }
    if names.may_be_strays(pairs.n) {
        writer.drop_strays(pairs.n);
    }
    Some(words)
}

/// Has the names of some blocks' columns brought into the cache.
#[target_feature(enable = "avx512f")]
#[inline]
fn fetch_names(order: &[u32], blocks: &[u32; STEP]) {
    for block in blocks {
        let names = order.as_ptr().wrapping_add(*block as usize * 32);
        _mm_prefetch::<_MM_HINT_T0>(names.cast());
        _mm_prefetch::<_MM_HINT_T0>(names.wrapping_add(16).cast());
    }
}

/// [`SparseWord::without_strays`] of 16 words: rows, blocks and bits. Copies, since the mask lies in
/// memory that another process can write to: what was looked at is what is used.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
#[inline]
fn without_strays(n: BoxCount, words: [&[u32; STEP]; 3]) -> [[u32; STEP]; 3] {
    // SAFETY: each array holds the 16 words of a register.
    let [row, block, bits] = words.map(|w| unsafe { _mm512_loadu_si512(w.as_ptr().cast()) });
    let row_block = _mm512_srli_epi32::<5>(row);
    let last_block = _mm512_set1_epi32((n.get() / 32) as i32);
    let from_row = _mm512_cmpge_epu32_mask(block, row_block);
    let in_range = _mm512_mask_cmple_epu32_mask(from_row, block, last_block);
    let bits = _mm512_maskz_mov_epi32(in_range, bits);
    let row_bit = _mm512_and_si512(row, _mm512_set1_epi32(31));
    let after_row = _mm512_sllv_epi32(_mm512_set1_epi32(-2), row_bit);
    let of_row = _mm512_cmpeq_epi32_mask(block, row_block);
    let bits = _mm512_mask_and_epi32(bits, of_row, bits, after_row);
    let before_n = _mm512_set1_epi32(!(u32::MAX << (n.get() % 32)) as i32);
    let at_end = _mm512_cmpeq_epi32_mask(block, last_block);
    let bits = _mm512_mask_and_epi32(bits, at_end, bits, before_n);
    [row, block, bits].map(|register| {
        let mut out = [0; STEP];
        // SAFETY: 16 u32, exclusively borrowed, are the 64 bytes of a register.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), register) };
        out
    })
}

/// Boxes by position, and what was seen of those that were put.
struct Names<'a> {
    order: &'a [u32],
    /// Largest box of each lane.
    largest: __m256i,
    /// Lanes that had a box twice.
    equal: __mmask8,
}

impl Names<'_> {
    /// Adds the pairs of boxes of a word. There must be room for [`WORD_ROOM`].
    ///
    /// # Safety
    /// Each bit must be that of a column below the length of the order.
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2,popcnt,bmi1,bmi2")]
    #[inline]
    unsafe fn put_word(&mut self, word: SparseWord, writer: &mut PairWriter) {
        let SparseWord { row, block, bits } = word;
        // A row without a bit may be none, and its name is then seen as a stray.
        let row = self.order.get(row as usize).copied().unwrap_or(u32::MAX);
        let row = _mm256_set1_epi32(row as i32);
        let columns = self.order.as_ptr().wrapping_add((block as usize).wrapping_mul(32));
        // SAFETY: only lanes with a bit are read, and the caller vouches for those.
        let (low, high) = unsafe {
            (
                _mm512_maskz_loadu_epi32(bits as __mmask16, columns.cast()),
                _mm512_maskz_loadu_epi32(
                    (bits >> 16) as __mmask16,
                    columns.wrapping_add(16).cast(),
                ),
            )
        };
        let mut bit_numbers = _mm256_maskz_compress_epi8(bits, numbers_to_31());
        let mut rest = bits.count_ones() as usize;
        loop {
            let picked = _mm256_cvtepu8_epi32(_mm256_castsi256_si128(bit_numbers));
            let column = _mm512_permutex2var_epi32(low, _mm512_castsi256_si512(picked), high);
            self.put_eight(row, _mm512_castsi512_si256(column), rest.min(EIGHT), writer);
            if rest <= EIGHT {
                return;
            }
            rest -= EIGHT;
            bit_numbers = _mm256_permute4x64_epi64::<0b11_11_10_01>(bit_numbers);
        }
    }

    /// Adds the pairs of the first `count` lanes.
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
    #[inline]
    fn put_eight(&mut self, row: __m256i, column: __m256i, count: usize, writer: &mut PairWriter) {
        let a = _mm256_min_epu32(row, column);
        let b = _mm256_max_epu32(row, column);
        // Lanes behind the last pair have box 0, or that of some column: they raise no alarm, but
        // for the few words of box 0.
        self.largest = _mm256_max_epu32(self.largest, b);
        self.equal |= _mm256_cmpeq_epi32_mask(a, b);
        let in_turn = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
        let (a, b) = (_mm512_castsi256_si512(a), _mm512_castsi256_si512(b));
        let pairs = _mm512_permutex2var_epi32(a, in_turn, b);
        // SAFETY: both types are 64 bytes without padding, and every bit pattern is one of both.
        let eight: [[u32; 2]; EIGHT] = unsafe { std::mem::transmute(pairs) };
        writer.put_first_of(count, eight);
    }

    /// Whether a pair may have been put that is none. False only where there is none.
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt,bmi1,bmi2")]
    #[inline]
    fn may_be_strays(&self, n: BoxCount) -> bool {
        let n = _mm256_set1_epi32(n.get() as i32);
        (self.equal | _mm256_cmpge_epu32_mask(self.largest, n)) != 0
    }
}

/// Bytes 0 to 31.
#[target_feature(enable = "avx512f,avx512vl")]
#[inline]
fn numbers_to_31() -> __m256i {
    const NUMBERS: [u8; 32] = {
        let mut numbers = [0; 32];
        let mut i = 0;
        while i < numbers.len() {
            numbers[i] = i as u8;
            i += 1;
        }
        numbers
    };
    // SAFETY: 32 bytes are those of the register.
    unsafe { _mm256_loadu_si256(NUMBERS.as_ptr().cast()) }
}
