//! Found words → a dense mask: bit k of the string is pair k.

use super::words::WordList;

/// The part of a dense mask that one thread writes.
///
/// Rows begin at any bit, so two neighbours may share a word. It belongs to the later one; what the
/// earlier one has for it comes back as a carry. So each word has one writer.
pub(super) struct DenseWindow<'a> {
    words: &'a mut [u32],
    first_word: u64,
    n: u64,
    carry: u32,
}

/// Index of the first pair of a row, n boxes: row n starts where the string ends.
pub(super) fn first_pair(row: usize, n: usize) -> u64 {
    let (row, n) = (row as u64, n as u64);
    // One factor is even, and n < 2^32 keeps the product in u64.
    row * (2 * n - row).saturating_sub(1) / 2
}

/// Word of the first pair of a row: where its thread's window starts.
pub(super) fn first_word(row: usize, n: usize) -> u64 {
    first_pair(row, n) / 32
}

impl<'a> DenseWindow<'a> {
    /// The words from `first_word` on, set to zero.
    pub fn new(words: &'a mut [u32], first_word: u64, n: usize) -> Self {
        words.fill(0);
        Self { words, first_word, n: n as u64, carry: 0 }
    }

    /// Sets the bits of all words found.
    pub fn write(&mut self, found: &WordList) {
        let [rows, blocks, bits] = found.arrays();
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
        let mut found = WordList::default();
        found.make_room(1);
        found.push(1, 0, 0b1100);
        let mut window = DenseWindow::new(&mut [], 0, 4);
        window.write(&found);
        assert_eq!(window.carry(), 0b1_1000);
    }
}
