//! Word by word, without a branch on any single bit.
//!
//! Stray bits of 16 words go first, all together. Then each word writes four pairs, and counts as many
//! as it has bits: the next word overwrites the others. Few words have more than four. Where an order
//! names the boxes, the row is looked up once a word, and the columns of a word are 32 positions in
//! sequence. The two of each pair are brought into order at the end, all together.

use super::super::sparse_words::SparseWord;
use super::SparsePairs;
use crate::mask::pair_buffer::{CAPACITY, PairWriter, WORD_PAIRS};
use crate::simd::per_isa;
use crate::units::BoxCount;

/// Words whose stray bits are taken away together.
const STEP: usize = 16;

/// Pairs that are written at a time, needed or not.
const AT_A_TIME: usize = 4;

/// Columns of a word, and what is read in place of a column where there is no bit.
const NAMES: usize = WORD_PAIRS + 1;

/// Rows and columns that were found, by name.
struct Found {
    rows: [u32; CAPACITY],
    columns: [u32; CAPACITY],
}

impl Found {
    /// Puts the pairs of a word, whose bits are all of columns below the number of boxes, behind the
    /// first `len`. There must be room. Returns how many there are then: counted by the caller, so that
    /// the count stays in a register.
    #[inline(always)]
    fn put_word<N: Names>(&mut self, len: usize, word: SparseWord, names: &N) -> usize {
        let (row, columns) = (names.row(word.row), names.columns(word.block));
        let mut rest = word.bits;
        let count = word.bits.count_ones() as usize;
        let mut at = len;
        loop {
            let four = [(); AT_A_TIME].map(|()| {
                let bit = rest.trailing_zeros();
                rest &= rest.wrapping_sub(1);
                N::column(&columns, bit)
            });
            let rows = self.rows.get_mut(at..).and_then(<[u32]>::first_chunk_mut);
            let columns = self.columns.get_mut(at..).and_then(<[u32]>::first_chunk_mut);
            let (Some(rows), Some(columns)) = (rows, columns) else { break };
            (*rows, *columns) = ([row; AT_A_TIME], four);
            at += AT_A_TIME;
            if rest == 0 {
                break;
            }
        }
        len + count
    }
}

/// What positions are called.
trait Names {
    /// The names of a word's columns.
    type Columns<'c>
    where
        Self: 'c;

    fn row(&self, row: u32) -> u32;

    fn columns(&self, block: u32) -> Self::Columns<'_>;

    /// The name of column `bit`, at most 32.
    fn column(columns: &Self::Columns<'_>, bit: u32) -> u32;
}

/// Positions are boxes.
struct Same;

impl Names for Same {
    type Columns<'c> = u32;

    #[inline(always)]
    fn row(&self, row: u32) -> u32 {
        row
    }

    #[inline(always)]
    fn columns(&self, block: u32) -> u32 {
        block << 5
    }

    #[inline(always)]
    fn column(columns: &u32, bit: u32) -> u32 {
        columns.wrapping_add(bit)
    }
}

/// The box at each position.
struct Ordered<'o> {
    order: &'o [u32],
    /// Those of the last block, filled up with names that no box has.
    last: [u32; NAMES],
}

impl<'o> Ordered<'o> {
    #[inline(always)]
    fn new(order: &'o [u32]) -> Self {
        let first = order.len().saturating_sub(1) / WORD_PAIRS * WORD_PAIRS;
        let mut last = [u32::MAX; NAMES];
        for (last, name) in last.iter_mut().zip(order.get(first..).unwrap_or(&[])) {
            *last = *name;
        }
        Self { order, last }
    }
}

impl Names for Ordered<'_> {
    type Columns<'c>
        = &'c [u32; NAMES]
    where
        Self: 'c;

    #[inline(always)]
    fn row(&self, row: u32) -> u32 {
        self.order.get(row as usize).copied().unwrap_or(u32::MAX)
    }

    #[inline(always)]
    fn columns(&self, block: u32) -> &[u32; NAMES] {
        let first = (block as usize).saturating_mul(WORD_PAIRS);
        // A block behind the last one has no bits any more.
        self.order.get(first..).and_then(<[u32]>::first_chunk).unwrap_or(&self.last)
    }

    #[inline(always)]
    fn column(columns: &&[u32; NAMES], bit: u32) -> u32 {
        columns[bit.min(WORD_PAIRS as u32) as usize]
    }
}

/// Whether the pairs of a word fit behind the first `len`.
#[inline(always)]
const fn has_room(len: usize) -> bool {
    len + WORD_PAIRS <= CAPACITY
}

per_isa! {
    /// Puts the pairs of words until there is no more room. False at the end.
    pub(super) fn write<simd: S>(pairs: &mut SparsePairs<'_>, writer: &mut PairWriter) -> bool {
        let _ = simd;
        match pairs.order {
            None => write_named(pairs, &Same, writer),
            Some(order) => write_named(pairs, &Ordered::new(order), writer),
        }
    }
}

#[inline(always)]
fn write_named(pairs: &mut SparsePairs<'_>, names: &impl Names, writer: &mut PairWriter) -> bool {
    let words = &mut pairs.words;
    if words.split_first().is_none() {
        return false;
    }
    let mut found = Found { rows: [0; CAPACITY], columns: [0; CAPACITY] };
    let mut len = 0;
    while has_room(len)
        && let Some((step, rest)) = words.split_first_chunk::<STEP>()
    {
        let [rows, blocks, bits] = without_strays(pairs.n, step);
        let mut done = 0;
        while done < STEP && has_room(len) {
            let word = SparseWord { row: rows[done], block: blocks[done], bits: bits[done] };
            len = found.put_word(len, word, names);
            done += 1;
        }
        *words = if done == STEP { rest } else { words.without_first(done) };
    }
    // Fewer than a step at the end of the mask; after a full buffer there is no room for any.
    while has_room(len)
        && let Some((word, rest)) = words.split_first()
    {
        len = found.put_word(len, word.without_strays(pairs.n), names);
        *words = rest;
    }
    writer.put_all(&found.rows, &found.columns, len);
    writer.drop_strays(pairs.n);
    true
}

/// [`SparseWord::without_strays`] of 16 words: rows, blocks and bits. Copies, since the mask lies in
/// memory that another process can write to: what was looked at is what is used.
#[inline(always)]
fn without_strays(n: BoxCount, [rows, blocks, bits]: [&[u32; STEP]; 3]) -> [[u32; STEP]; 3] {
    let (rows, blocks, mut bits) = (*rows, *blocks, *bits);
    for ((bits, row), block) in bits.iter_mut().zip(rows).zip(blocks) {
        *bits &= SparseWord { row, block, bits: 0 }.valid_mask(n);
    }
    [rows, blocks, bits]
}
