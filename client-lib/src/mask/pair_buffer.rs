//! A few pairs between the decoder and whoever takes them.
//!
//! Most words hold one bit, some two or more, and no branch predictor can tell which: a loop over
//! the bits of each word, with the consumer's code inside, spends most of its time on wrong
//! guesses. The decoders therefore write pairs here first, unconditionally, and only count on
//! where the pair was real. The consumer then takes them in a loop that is easy to predict.

use crate::units::BoxCount;

/// Pairs in a buffer: 1 KiB, so that it stays in the first-level cache and costs little to set up
/// for a mask of a few words. A power of two, so that an index is kept within by a mask.
const CAPACITY: usize = 128;

/// Most pairs of a word.
const WORD_PAIRS: usize = 32;

/// Decoded pairs that were not yet taken.
#[derive(Clone)]
pub(super) struct PairBuffer {
    pairs: [(u32, u32); CAPACITY],
    /// The pair to be taken next.
    next: usize,
    /// End of the pairs, at most [`CAPACITY`].
    end: usize,
}

impl PairBuffer {
    pub const fn new() -> Self {
        Self { pairs: [(0, 0); CAPACITY], next: 0, end: 0 }
    }

    /// Replaces whatever is left by what `write` puts.
    #[inline(always)]
    pub fn refill(&mut self, write: impl FnOnce(&mut PairWriter)) {
        let mut writer = PairWriter { pairs: &mut self.pairs, end: 0 };
        write(&mut writer);
        (self.next, self.end) = (0, writer.end);
    }

    /// Takes one pair.
    #[inline]
    pub fn take(&mut self) -> Option<(u32, u32)> {
        let pair = self.as_slice().first().copied()?;
        self.next += 1;
        Some(pair)
    }

    /// The pairs that were not yet taken.
    #[inline]
    pub fn as_slice(&self) -> &[(u32, u32)] {
        self.pairs.get(self.next..self.end).unwrap_or(&[])
    }
}

/// Writes pairs into an empty buffer.
///
/// A value of its own, so that the count stays in a register: read back from the buffer after
/// each pair, it alone would take longer than all the rest.
pub(super) struct PairWriter<'b> {
    pairs: &'b mut [(u32, u32); CAPACITY],
    end: usize,
}

impl PairWriter<'_> {
    /// Whether the pairs of one more word fit.
    #[inline(always)]
    pub const fn has_room(&self) -> bool {
        self.end <= CAPACITY - WORD_PAIRS
    }

    /// Adds a pair if it is real, without a branch. There must be room.
    #[inline(always)]
    pub const fn put_if(&mut self, real: bool, pair: (u32, u32)) {
        self.pairs[self.end % CAPACITY] = pair;
        self.end += real as usize;
    }

    /// Turns each pair into what `name` makes of it and drops what is no pair of `n` boxes.
    ///
    /// A well-formed mask has nothing to drop, so the pass only looks whether there is anything.
    #[inline(always)]
    pub fn settle(&mut self, n: BoxCount, name: impl Fn((u32, u32)) -> (u32, u32)) {
        let is_pair = |(a, b): (u32, u32)| (a < b) & (b < n.get());
        let written = self.pairs.get_mut(..self.end).unwrap_or(&mut []);
        let mut stray = false;
        for pair in written.iter_mut() {
            *pair = name(*pair);
            stray |= !is_pair(*pair);
        }
        if stray {
            let mut kept = 0;
            for i in 0..written.len() {
                written[kept] = written[i];
                kept += usize::from(is_pair(written[i]));
            }
            self.end = kept;
        }
    }
}
