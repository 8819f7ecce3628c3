//! Mask words with columns that the bitmaps could not rule out.

use super::bitmaps::LINE_WORDS;

/// Non-zero 64-bit words with their addresses, in the order in which they were found.
#[derive(Default)]
pub(super) struct Candidates {
    addresses: Vec<u64>,
    bits: Vec<u64>,
    len: usize,
}

/// The next eight places for addresses and bits, to be written by one SIMD store each.
pub(super) struct Line<'a> {
    /// Places for [`address`]es.
    pub addresses: &'a mut [u64; LINE_WORDS],
    /// Places for the words.
    pub bits: &'a mut [u64; LINE_WORDS],
}

/// Row and word in one number, so that one store writes both.
#[inline(always)]
pub(super) const fn address(row: usize, word: usize) -> u64 {
    (row as u64) << 32 | word as u64
}

impl Candidates {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        (self.addresses.capacity() + self.bits.capacity()) * size_of::<u64>()
    }

    /// Forgets all words and keeps the memory.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Makes room for so many more words, and for a line that is written before it is known how
    /// much of it to keep.
    #[inline(always)]
    pub fn make_room(&mut self, words: usize) {
        let needed = self.len + words + LINE_WORDS;
        if needed > self.bits.len() {
            let len = needed.max(2 * self.bits.len());
            self.addresses.resize(len, 0);
            self.bits.resize(len, 0);
        }
    }

    /// Has `write` fill the next eight places and keeps as many as it says.
    ///
    /// # Panics
    /// Without [`Self::make_room`] before.
    #[inline(always)]
    pub fn append(&mut self, write: impl FnOnce(Line<'_>) -> usize) {
        let places = self.addresses[self.len..].first_chunk_mut();
        let places = places.zip(self.bits[self.len..].first_chunk_mut());
        if let Some((addresses, bits)) = places {
            self.len += write(Line { addresses, bits }).min(LINE_WORDS);
        } else {
            unreachable!("make_room keeps a line free");
        }
    }

    /// Words kept.
    pub fn len(&self) -> usize {
        self.len
    }

    /// (row, word, bits) of each.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (u32, u32, u64)> {
        let (addresses, bits) = (&self.addresses[..self.len], &self.bits[..self.len]);
        addresses.iter().zip(bits).map(|(&at, &bits)| ((at >> 32) as u32, at as u32, bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_keeps_what_it_says() {
        let mut candidates = Candidates::default();
        for row in 0..3 {
            candidates.make_room(LINE_WORDS);
            candidates.append(|line| {
                line.addresses.fill(address(row, 7));
                line.bits.fill(row as u64 + 1);
                row
            });
        }
        let kept: Vec<_> = candidates.iter().collect();
        assert_eq!(kept, [(1, 7, 2), (2, 7, 3), (2, 7, 3)]);
        candidates.clear();
        assert_eq!(candidates.iter().count(), 0);
    }
}
