//! What all decoders of the study share: words in, pairs of boxes out.
//!
//! As the production decoder does, positions are written to a buffer first, without a branch on
//! single bits, and become boxes a buffer at a time. Unlike it, there is no vector code: forms are
//! compared with one another by the craft that they all have.

/// Pairs in the buffer: 2 KiB, as in the production decoder, so that masks of a few words pay as much
/// for setting it up. A power of two, so that an index is kept within by a mask.
const CAPACITY: usize = 256;

/// Most pairs of a word of any form: the room that one needs.
const WORD_PAIRS: usize = u64::BITS as usize;

/// Takes words and gives pairs of boxes (a, b), a < b < n.
pub(super) struct PairSink<'o, F> {
    n: u32,
    order: Option<&'o [u32]>,
    positions: [[u32; 2]; CAPACITY],
    end: usize,
    take: F,
}

impl<'o, F: FnMut(u32, u32)> PairSink<'o, F> {
    /// A sink for a mask of `n` boxes that are named by `order`.
    #[inline(always)]
    pub const fn new(n: u32, order: Option<&'o [u32]>, take: F) -> Self {
        Self { n, order, positions: [[0; 2]; CAPACITY], end: 0, take }
    }

    /// Takes a word: bit t is the pair of positions (row, `first_column` + t).
    ///
    /// `first_column` is a multiple of the word's bits, or 2^32 − 1 where that does not fit.
    #[inline(always)]
    pub fn put_word(&mut self, row: u32, first_column: u32, mut bits: u64) {
        if self.end + WORD_PAIRS > CAPACITY {
            self.flush();
        }
        // The inner or keeps a word without a bit, which is not counted, from asking for one.
        let lowest = |bits: u64| [row, first_column | (bits | 1 << 63).trailing_zeros()];
        // Two without a branch: few words have more, and those that do are worth a wrong guess.
        for _ in 0..2 {
            self.positions[self.end % CAPACITY] = lowest(bits);
            self.end += usize::from(bits != 0);
            bits &= bits.wrapping_sub(1);
        }
        while bits != 0 {
            self.positions[self.end % CAPACITY] = lowest(bits);
            self.end += 1;
            bits &= bits - 1;
        }
    }

    /// Gives whatever is left.
    #[inline(always)]
    pub fn finish(mut self) {
        self.flush();
    }

    /// Gives the pairs of the buffer, less what is no pair: a mask from another process would have
    /// to be read so, and the time of a decoder without these tests would say nothing.
    #[inline(always)]
    fn flush(&mut self) {
        let (n, take) = (self.n, &mut self.take);
        let written = self.positions.get(..self.end).unwrap_or(&[]);
        let pairs = written.iter().filter(|[row, column]| row < column && *column < n);
        match self.order {
            None => pairs.for_each(|[a, b]| take(*a, *b)),
            Some(order) => pairs.for_each(|positions| {
                let name = |p: u32| order.get(p as usize).copied().unwrap_or(u32::MAX);
                let [p, q] = positions.map(name);
                if p != q && p.max(q) < n {
                    take(p.min(q), p.max(q));
                }
            }),
        }
        self.end = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(n: u32, order: Option<&[u32]>, words: &[(u32, u32, u64)]) -> Vec<(u32, u32)> {
        let mut found = Vec::new();
        let mut sink = PairSink::new(n, order, |a, b| found.push((a, b)));
        for (row, first_column, bits) in words {
            sink.put_word(*row, *first_column, *bits);
        }
        sink.finish();
        found
    }

    #[test]
    fn words_of_any_number_of_bits_fit() {
        let words: Vec<_> = (0..70).map(|row| (row, 128, u64::MAX)).collect();
        let expected: Vec<_> = (0..70).flat_map(|a| (128..192).map(move |b| (a, b))).collect();
        assert_eq!(pairs(192, None, &words), expected);
        assert_eq!(pairs(192, None, &[(0, 64, 0)]), []);
    }

    #[test]
    fn strays_are_dropped() {
        assert_eq!(pairs(4, None, &[(1, 0, 0b1_1111)]), [(1, 2), (1, 3)]);
        assert_eq!(pairs(4, None, &[(1, u32::MAX, 1)]), []);
        // Position 1 has no box, and position 3 that of position 0.
        let order = [2, 4, 0, 2];
        assert_eq!(pairs(4, Some(&order), &[(0, 0, 0b1110)]), [(0, 2)]);
    }
}
