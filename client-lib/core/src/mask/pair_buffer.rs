//! A few pairs between the decoder and its consumer.
//!
//! Most words hold one bit, some two or more, and no branch predictor can decide which: a loop over
//! the bits of each word, with the consumer's code inside, spends most of its time on wrong
//! guesses. The decoders therefore write pairs here first, unconditionally, and only count on
//! where the pair was real. The consumer then takes them in a loop that is easy to predict.

use super::fetch_ahead;
use super::pair_check::{are_pairs, plain};
use crate::isa::AvailableIsa;
use crate::units::BoxCount;

/// Pairs in a buffer: 2 KiB, so that it stays in the first-level cache and costs little to set up
/// for a mask of a few words. A power of two, so that an index is kept within by a mask.
pub(super) const CAPACITY: usize = 256;

/// Most pairs of a word: the room that it needs.
pub(super) const WORD_PAIRS: usize = u32::BITS as usize;

/// Decoded pairs that were not yet taken.
#[derive(Clone)]
pub(super) struct PairBuffer {
    pairs: [[u32; 2]; CAPACITY],
    /// The pair to be taken next.
    next: usize,
    /// End of the pairs, at most [`CAPACITY`].
    end: usize,
}

impl PairBuffer {
    pub const fn new() -> Self {
        Self { pairs: [[0; 2]; CAPACITY], next: 0, end: 0 }
    }

    /// Replaces what is left by what `write` puts.
    #[inline]
    pub fn refill(&mut self, write: impl FnOnce(&mut PairWriter)) {
        let mut writer = PairWriter { pairs: &mut self.pairs, end: 0 };
        write(&mut writer);
        (self.next, self.end) = (0, writer.end);
    }

    /// Takes one pair.
    #[inline]
    pub fn take(&mut self) -> Option<[u32; 2]> {
        let pair = *self.as_slice().first()?;
        self.next += 1;
        Some(pair)
    }

    /// The pairs that were not yet taken.
    #[inline]
    pub fn as_slice(&self) -> &[[u32; 2]] {
        self.pairs.get(self.next..self.end).unwrap_or(&[])
    }
}

/// Writes pairs into an empty buffer.
///
/// A value of its own, so that the count stays in a register: read back from the buffer after
/// each pair, it alone would take longer than all the rest.
pub(super) struct PairWriter<'b> {
    pairs: &'b mut [[u32; 2]; CAPACITY],
    end: usize,
}

impl PairWriter<'_> {
    /// Whether so many pairs fit.
    #[inline(always)]
    pub const fn has_room_for(&self, pairs: usize) -> bool {
        self.end + pairs <= CAPACITY
    }

    /// Pairs that fit.
    #[inline(always)]
    pub const fn room(&self) -> usize {
        CAPACITY - self.end
    }

    /// Adds those of some pairs that are pairs of `n`, smaller first. There must be room for all.
    ///
    /// Another process may write to `pairs` at any time. They are copied first, and what was copied
    /// is what is checked and given out.
    #[inline(always)]
    pub fn put_checked(&mut self, pairs: &[[u32; 2]], n: BoxCount, isa: AvailableIsa) {
        let start = self.end;
        let end = start + pairs.len();
        if let Some(room) = self.pairs.get_mut(self.end..end) {
            fetch_ahead::copy(pairs, room, isa);
            self.end = end;
        }
        // The copy, not the memory that it was made from, is looked at from here on: to the compiler
        // it may hold anything.
        std::hint::black_box(&mut *self.pairs);
        if !are_pairs(self.pairs.get(start..self.end).unwrap_or(&[]), n, isa) {
            self.drop_strays(n);
        }
    }

    /// Adds a pair if it is real, without a branch. There must be room.
    #[inline(always)]
    pub const fn put_if(&mut self, real: bool, pair: [u32; 2]) {
        debug_assert!(self.has_room_for(1));
        self.pairs[self.end % CAPACITY] = pair;
        self.end += real as usize;
    }

    /// Adds the first `count` of `N` pairs. There must be room for `N`.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn put_first_of<const N: usize>(&mut self, count: usize, pairs: [[u32; 2]; N]) {
        debug_assert!(count <= N && self.has_room_for(N));
        if let Some(room) = self.pairs.get_mut(self.end..).and_then(|rest| rest.first_chunk_mut()) {
            *room = pairs;
            self.end += count;
        }
    }

    /// Drops what is no pair of `n`.
    ///
    /// A well-formed mask has nothing to drop, so this first only looks whether there is anything.
    #[inline(always)]
    pub fn drop_strays(&mut self, n: BoxCount) {
        let is_pair = |[a, b]: [u32; 2]| (a < b) & (b < n.get());
        let written = self.pairs.get_mut(..self.end).unwrap_or(&mut []);
        if plain(written, n) {
            return;
        }
        let mut kept = 0;
        for i in 0..written.len() {
            written[kept] = written[i];
            kept += usize::from(is_pair(written[i]));
        }
        self.end = kept;
    }

    /// Turns pairs of positions into pairs of the boxes there, smaller first. A position that the
    /// order does not have becomes box 2^32 − 1, which there never is.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn name_boxes(&mut self, order: &[u32]) {
        let written = self.pairs.get_mut(..self.end).unwrap_or(&mut []);
        // Two passes: the first only waits for memory, with nothing to guess wrong, and the second
        // is vector code.
        look_up(order, written.as_flattened_mut());
        for [a, b] in written {
            (*a, *b) = ((*a).min(*b), (*a).max(*b));
        }
    }

    /// Puts pairs of boxes into the empty buffer, smaller first: the first `count` of rows and columns.
    #[inline(always)]
    pub fn put_all(&mut self, rows: &[u32; CAPACITY], columns: &[u32; CAPACITY], count: usize) {
        self.end = count.min(CAPACITY);
        let written = self.pairs.get_mut(..self.end).unwrap_or(&mut []);
        for (pair, (row, column)) in written.iter_mut().zip(rows.iter().zip(columns)) {
            *pair = [*row.min(column), *row.max(column)];
        }
    }
}

/// Replaces each position by the box there.
///
/// A function of its own, so that it is not compiled for AVX-512 along with its caller: gather
/// instructions take longer than the loads that they stand for on half of the machines.
#[cfg(target_arch = "x86_64")]
#[inline(never)]
fn look_up(order: &[u32], positions: &mut [u32]) {
    for position in positions {
        *position = order.get(*position as usize).copied().unwrap_or(u32::MAX);
    }
}
