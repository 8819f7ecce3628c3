//! Mask words as they are found: non-zero, sorted by (row, block).

use crate::engine::encode::FoundWords;
use crate::engine::gather::Gather;

/// Non-zero 32-bit mask words in the three arrays of the sparse encoding.
///
/// The arrays are longer than what is used, so that a word can be appended without a branch:
/// whether half of a 64-bit word is zero is a coin toss that no branch predictor wins.
#[derive(Default)]
pub(super) struct WordList {
    rows: Vec<u32>,
    blocks: Vec<u32>,
    bits: Vec<u32>,
    len: usize,
    pair_count: u64,
}

impl FoundWords for WordList {
    fn chunks(&self) -> impl Iterator<Item = [&[u32]; 3]> {
        std::iter::once(self.arrays())
    }

    fn pair_count(&self) -> u64 {
        self.pair_count
    }
}

impl WordList {
    /// Drops all words and keeps the memory.
    pub fn clear(&mut self) {
        self.len = 0;
        self.pair_count = 0;
    }

    /// Makes room for so many more 64-bit words.
    pub fn make_room(&mut self, words64: usize) {
        // One word more than can be kept: an append writes before it knows whether to keep.
        let needed = self.len + 2 * words64 + 1;
        if needed > self.bits.len() {
            let len = needed.max(2 * self.bits.len());
            self.rows.resize(len, 0);
            self.blocks.resize(len, 0);
            self.bits.resize(len, 0);
        }
    }

    /// Appends the bits of columns `64·word` and up of a row, less the halves that are zero.
    ///
    /// # Panics
    /// Without [`Self::make_room`] before.
    #[inline(always)]
    pub fn push(&mut self, row: u32, word: u32, bits: u64) {
        for (block, half) in [(2 * word, bits as u32), (2 * word + 1, (bits >> 32) as u32)] {
            self.rows[self.len] = row;
            self.blocks[self.len] = block;
            self.bits[self.len] = half;
            self.len += usize::from(half != 0);
        }
        self.pair_count += u64::from(bits.count_ones());
    }

    /// Keeps, of the words from `first` on, what passes.
    pub fn sift(&mut self, first: usize, gather: &Gather<'_>) {
        let words = first..self.len;
        let arrays = [&mut self.rows, &mut self.blocks, &mut self.bits];
        let (kept, ended) = gather.sift(arrays.map(|array| &mut array[words.clone()]));
        self.len = first + kept;
        self.pair_count -= ended;
    }

    pub fn allocated_bytes(&self) -> usize {
        (self.rows.capacity() + self.blocks.capacity() + self.bits.capacity()) * size_of::<u32>()
    }

    /// Words appended.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Rows, blocks and bits.
    pub fn arrays(&self) -> [&[u32]; 3] {
        [&self.rows[..self.len], &self.blocks[..self.len], &self.bits[..self.len]]
    }
}
