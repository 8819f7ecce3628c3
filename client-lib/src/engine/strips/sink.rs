//! Hits to mask words: sorted by (row, block), none of them zero, each address once.

use super::StripBatch;

/// A word of the sparse encoding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct SparseWord {
    /// Position of the row.
    pub row: u32,
    /// Columns 32·block to 32·block + 31.
    pub block: u32,
    /// Bit t: column 32·block + t.
    pub bits: u32,
}

/// The words of one task's rows. Memory is kept from frame to frame.
#[derive(Default)]
pub(crate) struct WordSink {
    /// Longer than what is used: a word is stored before it is known whether it stays.
    words: Vec<SparseWord>,
    /// Words used. While `open` holds one, the next store completes it.
    len: usize,
    open: SparseWord,
    pair_count: u64,
}

impl WordSink {
    /// Forgets all words and keeps the memory.
    pub fn clear(&mut self) {
        *self = Self { words: std::mem::take(&mut self.words), ..Self::default() };
    }

    /// Adds the hits of a tested batch. Batches must come in rising order of (row, start).
    pub fn take(&mut self, batch: &StripBatch) {
        // A strip touches at most two words; one more for the word that stays open.
        let needed = self.len + 2 * batch.len() + 1;
        if self.words.len() < needed {
            let len = needed.max(self.words.len() + self.words.len() / 2);
            self.words.resize(len, SparseWord::default());
        }
        let words = &mut self.words[..needed];
        let (mut len, mut open, mut pair_count) = (self.len, self.open, 0u64);
        let mut push = |row: u32, block: u32, bits: u32| {
            let same = (open.row == row) & (open.block == block);
            let fresh = (bits != 0) & !same;
            words[len] = open;
            len += usize::from(fresh & (open.bits != 0));
            open = SparseWord {
                row: if fresh { row } else { open.row },
                block: if fresh { block } else { open.block },
                bits: bits | if fresh { 0 } else { open.bits },
            };
        };
        batch.for_each_hit(|hit| {
            let bits = u64::from(hit.bits) << (hit.start % 32);
            push(hit.row, hit.start / 32, bits as u32);
            push(hit.row, hit.start / 32 + 1, (bits >> 32) as u32);
            pair_count += u64::from(hit.bits.count_ones());
        });
        (self.len, self.open) = (len, open);
        self.pair_count += pair_count;
    }

    /// Adds a word that is known whole. Addresses must rise; a word of zero is left out.
    pub fn push(&mut self, row: u32, block: u32, bits: u32) {
        debug_assert_eq!(self.open.bits, 0, "words and batches do not mix");
        if bits != 0 {
            self.words.truncate(self.len);
            self.words.push(SparseWord { row, block, bits });
            self.len += 1;
            self.pair_count += u64::from(bits.count_ones());
        }
    }

    /// Completes the last word. Nothing may be taken after it.
    pub fn finish(&mut self) {
        if self.open.bits != 0 {
            if self.words.len() == self.len {
                self.words.push(self.open);
            } else {
                self.words[self.len] = self.open;
            }
            self.len += 1;
            self.open = SparseWord::default();
        }
    }

    /// The finished words.
    pub fn words(&self) -> &[SparseWord] {
        &self.words[..self.len]
    }

    /// Pairs of all hits.
    pub fn pair_count(&self) -> u64 {
        self.pair_count
    }
}
