//! The dense encoding: bit k of the string is pair k.
//!
//! Words of an engine that keeps the boxes' order are written window by window ([`DenseRows`]), those
//! of any order pair by pair ([`write`]).

use super::{EncodingCost, FoundWords, MaskWork};
use crate::engine::cost::terms;
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::MaskShape;
use crate::stats::SceneStats;
use crate::units::BoxCount;

terms! {
    BYTE = CostTerm::new("dense-byte", 0.0178);
    PAIR = CostTerm::new("dense-pair", 1.16);
    /// More for a pair of an engine that has an order of its own.
    SCATTERED_PAIR = CostTerm::new("scattered-pair", 1.54);
}

/// What dense masks take.
pub(super) const COST: EncodingCost = EncodingCost {
    write: MaskWork { terms: TERMS, amounts },
    visit: MaskWork { terms: visit::TERMS, amounts: visit::amounts },
    bytes: |stats, _| bytes(stats),
};

fn bytes(stats: &SceneStats) -> f64 {
    4.0 * stats.n.dense_words() as f64
}

fn amounts(stats: &SceneStats, has_order: bool, amounts: &mut [f64]) {
    let pairs = stats.expected_pairs();
    amounts[BYTE] = bytes(stats);
    amounts[PAIR] = pairs;
    amounts[SCATTERED_PAIR] = if has_order { pairs } else { 0.0 };
}

/// What the client does.
mod visit {
    use super::{CostTerm, SceneStats, bytes, terms};

    terms! {
        MASK = CostTerm::new("dense-visit", 101.0);
        BYTE = CostTerm::new("dense-visit-byte", 0.0351);
        PAIR = CostTerm::new("dense-visit-pair", 3.33);
    }

    pub(super) fn amounts(stats: &SceneStats, _: bool, amounts: &mut [f64]) {
        amounts[MASK] = 1.0;
        amounts[BYTE] = bytes(stats);
        amounts[PAIR] = stats.expected_pairs();
    }
}

/// Sets each pair's bit. The words of a dense mask are in box order and those of the tasks may be in
/// another, so this writes all over the mask: right, and slower than row by row, which is why the plan
/// never pairs a dense mask with an engine that has an order of its own.
pub(super) fn write<'a, W: FoundWords + 'a>(
    tasks: impl Iterator<Item = &'a W>,
    gather: &Gather<'_>,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError> {
    let (n, order) = (gather.budget.n(), gather.order);
    let shape = MaskShape::dense(n);
    let extent = shape.extent_words();
    let mask = &mut reply.reserve(extent)?[..extent as usize];
    mask.fill(0);
    let index = |position: u32| {
        if order.is_empty() { position } else { order[position as usize] }
    };
    let words = tasks.flat_map(FoundWords::chunks).flat_map(|[rows, blocks, bits]| {
        rows.iter().zip(blocks).zip(bits).map(|((row, block), bits)| (*row, *block, *bits))
    });
    for (row, block, bits) in words {
        let row = u64::from(index(row));
        let mut rest = bits;
        while rest != 0 {
            let column = u64::from(index(32 * block + rest.trailing_zeros()));
            let (a, b) = (row.min(column), row.max(column));
            // k = a(2n − a − 1)/2 + (b − a − 1), design.md §3.
            let k = a * (2 * u64::from(n.get()) - a - 1) / 2 + (b - a - 1);
            mask[(k / 32) as usize] |= 1 << (k % 32);
            rest &= rest - 1;
        }
    }
    Ok(shape)
}

/// A dense mask that is written row by row, in parts that threads write at once.
///
/// Rows begin at any bit, so that the last word of a part may be the first of the next. It belongs to
/// the next part; what the earlier one has for it comes back as a carry. So each word has one writer.
pub(crate) struct DenseRows<'a> {
    n: BoxCount,
    words: &'a mut [u32],
}

impl<'a> DenseRows<'a> {
    /// The mask of `n` boxes in memory of `reply`, contents unspecified.
    pub(super) fn reserve(n: BoxCount, reply: &'a mut dyn ReplyBuffer) -> Result<Self, CullError> {
        let extent = MaskShape::dense(n).extent_words();
        Ok(Self { n, words: &mut reply.reserve(extent)?[..extent as usize] })
    }

    /// All rows, to be split.
    pub fn window(&mut self) -> DenseWindow<'_> {
        DenseWindow { words: self.words, first_word: 0, n: u64::from(self.n.get()), carry: 0 }
    }

    /// Adds what a window had for the word after it. `end_row` is the row after its last.
    pub fn add_carry(&mut self, end_row: usize, carry: u32) {
        let word = first_word(end_row, self.n.len()) as usize;
        if let Some(word) = self.words.get_mut(word) {
            *word |= carry;
        }
    }

    pub fn shape(&self) -> MaskShape {
        MaskShape::dense(self.n)
    }
}

/// The part of a dense mask that one thread writes: the words of some rows.
pub(crate) struct DenseWindow<'a> {
    words: &'a mut [u32],
    first_word: u64,
    n: u64,
    carry: u32,
}

/// Index of the first pair of a row, n boxes: row n starts where the string ends.
fn first_pair(row: usize, n: usize) -> u64 {
    let (row, n) = (row as u64, n as u64);
    // One factor is even, and n < 2^32 keeps the product in u64.
    row * (2 * n - row).saturating_sub(1) / 2
}

/// Word of the first pair of a row: where the window of a part that begins with it starts.
fn first_word(row: usize, n: usize) -> u64 {
    first_pair(row, n) / 32
}

impl DenseWindow<'_> {
    /// The window of the rows before `row`, and that of the rows from it on.
    pub fn split_at_row(self, row: usize) -> (Self, Self) {
        let border = first_word(row, self.n as usize);
        let (low, high) = self.words.split_at_mut((border - self.first_word) as usize);
        (
            Self { words: low, carry: 0, ..self },
            Self { words: high, first_word: border, n: self.n, carry: 0 },
        )
    }

    /// Sets all words to zero: to be called before the first word is written.
    pub fn clear(&mut self) {
        self.words.fill(0);
    }

    /// Sets the bits of words: their rows, blocks and bits.
    pub fn write(&mut self, [rows, blocks, bits]: [&[u32]; 3]) {
        for ((&row, &block), &bits) in rows.iter().zip(blocks).zip(bits) {
            let (row, column) = (u64::from(row), u64::from(block) * 32);
            // Columns up to the row have no pair index: shift them out (their bits are zero).
            let skipped = (row + 1).saturating_sub(column);
            let column = column + skipped;
            let bits = u64::from(bits) >> skipped;
            let k = first_pair(row as usize, self.n as usize) + (column - row - 1);
            let at = (k / 32 - self.first_word) as usize;
            let shifted = bits << (k % 32);
            self.set(at, shifted as u32);
            self.set(at + 1, (shifted >> 32) as u32);
        }
    }

    fn set(&mut self, at: usize, bits: u32) {
        match self.words.get_mut(at) {
            Some(word) => *word |= bits,
            None => self.carry |= bits,
        }
    }

    /// Bits for the word after the window.
    pub fn carry(self) -> u32 {
        self.carry
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::BoxCount;

    #[test]
    fn rows_start_where_the_row_before_ends() {
        for n in 0..100usize {
            let mut k = 0;
            for row in 0..n {
                assert_eq!(first_pair(row, n), k);
                k += (n - 1 - row) as u64;
            }
            assert_eq!(first_pair(n, n), BoxCount::new(n as u32).pair_count());
        }
        let n = u32::MAX as usize;
        assert_eq!(first_pair(n, n), BoxCount::new(u32::MAX).pair_count());
    }

    #[test]
    fn what_lies_past_the_window_is_carried() {
        // 4 boxes: row 1 has pairs 3 and 4; a window of no words carries both.
        let mut window = DenseWindow { words: &mut [], first_word: 0, n: 4, carry: 0 };
        window.write([&[1], &[0], &[0b1100]]);
        assert_eq!(window.carry(), 0b1_1000);
    }
}
