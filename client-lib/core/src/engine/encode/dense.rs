//! The dense encoding: bit k of the string is pair k.
//!
//! Words of an engine that keeps the boxes' order are written window by window ([`DenseRows`]), those
//! of any order pair by pair ([`write`]).

use super::{EncodingCost, FoundWords};
use crate::cancel::{Cancel, Pace};
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::MaskShape;
use crate::pair_index::row_start;
use crate::stats::SceneStats;
use crate::units::BoxCount;

/// What dense masks take.
pub(super) const COST: EncodingCost = EncodingCost {
    write: &[
        CostTerm::new(0.0178, |stats, _| bytes(stats)),
        CostTerm::new(1.16, |stats, _| stats.expected_pairs()),
        // More for a pair of an engine that has an order of its own.
        CostTerm::new(1.54, SceneStats::ordered_pairs),
    ],
    iterate: &[
        CostTerm::new(101.0, |_, _| 1.0),
        CostTerm::new(0.0351, |stats, _| bytes(stats)),
        CostTerm::new(3.33, |stats, _| stats.expected_pairs()),
    ],
    bytes: |stats, _| bytes(stats),
};

fn bytes(stats: &SceneStats) -> f64 {
    4.0 * stats.n.dense_words() as f64
}

/// Words that are set to zero between two looks whether they are wanted: 256 KiB, some 30 µs where the memory is new.
const CLEARED_AT_ONCE: usize = 1 << 16;
/// A word whose pairs' bits are set all over the mask, in tests of boxes.
const WORD_TESTS: u64 = 32;

fn clear(words: &mut [u32], cancel: &Cancel) {
    let mut pace = Pace::default();
    for some in words.chunks_mut(CLEARED_AT_ONCE) {
        if cancel.look_after(some.len() as u64, &mut pace) {
            return;
        }
        some.fill(0);
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
    let (cancel, mut pace) = (gather.budget.cancel(), Pace::default());
    clear(mask, cancel);
    let index = |position: u32| {
        if order.is_empty() { position } else { order[position as usize] }
    };
    let words = tasks.flat_map(FoundWords::chunks).flat_map(|[rows, blocks, bits]| {
        rows.iter().zip(blocks).zip(bits).map(|((row, block), bits)| (*row, *block, *bits))
    });
    for (row, block, bits) in words {
        if cancel.look_after(WORD_TESTS, &mut pace) {
            break;
        }
        let row = index(row);
        let mut rest = bits;
        while rest != 0 {
            let column = index(32 * block + rest.trailing_zeros());
            let (a, b) = (row.min(column), row.max(column));
            let k = row_start(n, a) + u64::from(b - a - 1);
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
    pub fn reserve(n: BoxCount, reply: &'a mut dyn ReplyBuffer) -> Result<Self, CullError> {
        let extent = MaskShape::dense(n).extent_words();
        Ok(Self { n, words: &mut reply.reserve(extent)?[..extent as usize] })
    }

    /// All rows, to be split.
    pub fn window(&mut self) -> DenseWindow<'_> {
        DenseWindow { words: self.words, first_word: 0, n: self.n, carry: 0 }
    }

    /// Adds what a window had for the word after it. `end_row` is the row after its last.
    pub fn add_carry(&mut self, end_row: usize, carry: u32) {
        let word = first_word(end_row, self.n) as usize;
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
    n: BoxCount,
    carry: u32,
}

/// Word of the first pair of a row: where the window of a part that begins with it starts.
fn first_word(row: usize, n: BoxCount) -> u64 {
    row_start(n, row as u32) / 32
}

impl DenseWindow<'_> {
    /// The window of the rows before `row`, and that of the rows from it on.
    pub fn split_at_row(self, row: usize) -> (Self, Self) {
        let border = first_word(row, self.n);
        let (low, high) = self.words.split_at_mut((border - self.first_word) as usize);
        (
            Self { words: low, carry: 0, ..self },
            Self { words: high, first_word: border, n: self.n, carry: 0 },
        )
    }

    /// Sets all words to zero: to be called before the first word is written. Ends early where nobody wants them.
    pub fn clear(&mut self, cancel: &Cancel) {
        clear(self.words, cancel);
    }

    /// Sets the bits of words: their rows, blocks and bits.
    pub fn write(&mut self, [rows, blocks, bits]: [&[u32]; 3]) {
        for ((&row, &block), &bits) in rows.iter().zip(blocks).zip(bits) {
            let (first_pair, row, column) =
                (row_start(self.n, row), u64::from(row), u64::from(block) * 32);
            // Columns up to the row have no pair index: shift them out (their bits are zero).
            let skipped = (row + 1).saturating_sub(column);
            let column = column + skipped;
            let bits = u64::from(bits) >> skipped;
            let k = first_pair + (column - row - 1);
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

    #[test]
    fn what_lies_past_the_window_is_carried() {
        // 4 boxes: row 1 has pairs 3 and 4; a window of no words carries both.
        let mut window =
            DenseWindow { words: &mut [], first_word: 0, n: BoxCount::new(4), carry: 0 };
        window.write([&[1], &[0], &[0b1100]]);
        assert_eq!(window.carry(), 0b1_1000);
    }
}
