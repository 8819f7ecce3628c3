//! Mask words with columns that the bitmaps could not rule out.

/// Non-zero 64-bit words with their addresses, in the order in which they were found.
#[derive(Default)]
pub(super) struct Candidates {
    rows: Vec<u32>,
    words: Vec<u32>,
    bits: Vec<u64>,
    len: usize,
}

impl Candidates {
    /// Forgets all words and keeps the memory.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Makes room for so many more words, and one to write before it is known whether to keep it.
    #[inline(always)]
    pub fn make_room(&mut self, words: usize) {
        let needed = self.len + words + 1;
        if needed > self.bits.len() {
            let len = needed.max(2 * self.bits.len());
            self.rows.resize(len, 0);
            self.words.resize(len, 0);
            self.bits.resize(len, 0);
        }
    }

    /// Appends a word unless it is zero, without a branch.
    ///
    /// # Panics
    /// Without [`Self::make_room`] before.
    #[inline(always)]
    pub fn push(&mut self, row: u32, word: u32, bits: u64) {
        self.rows[self.len] = row;
        self.words[self.len] = word;
        self.bits[self.len] = bits;
        self.len += usize::from(bits != 0);
    }

    /// (row, word, bits) of each.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (u32, u32, u64)> {
        let (rows, words, bits) =
            (&self.rows[..self.len], &self.words[..self.len], &self.bits[..self.len]);
        rows.iter().zip(words).zip(bits).map(|((&row, &word), &bits)| (row, word, bits))
    }
}
