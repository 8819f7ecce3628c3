//! List masks: the pairs themselves.

use std::fmt;
use std::ops::Range;

use crate::mask::pair_buffer::PairWriter;
use crate::mask::{AddressedWord, MaskError, Section, Span, WordAddress};
use crate::units::{BoxCount, MaskWord};

/// A list of pairs, smaller index first, sorted.
#[derive(Clone, Copy)]
pub struct ListMask<'a> {
    n: BoxCount,
    pairs: &'a [[u32; 2]],
}

impl<'a> ListMask<'a> {
    pub(super) fn new(n: BoxCount, pairs: &Span, reply: &'a [u32]) -> Result<Self, MaskError> {
        // The wire contract refuses an odd word at the end; here it is no pair.
        let (pairs, _) = Section::Words.of(pairs, reply)?.as_chunks();
        Ok(Self { n, pairs })
    }

    /// Number of boxes.
    #[inline]
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Number of pairs, malformed ones included.
    #[inline]
    pub const fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether the list is empty.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Whether the mask names the pair of boxes `a` and `b`, in any order: a binary search. In a mask
    /// that `verify` rejects, a pair may go unfound.
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        let pair = [a.min(b), a.max(b)];
        is_pair(pair, self.n) && self.pairs.binary_search(&pair).is_ok()
    }

    /// Number of pairs.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.pairs.iter().filter(|pair| is_pair(**pair, self.n)).count() as u64
    }

    /// The pairs of a range.
    pub(super) fn pairs_in(&self, range: Range<usize>) -> ListPairs<'a> {
        ListPairs { n: self.n, rest: self.pairs.get(range).unwrap_or(&[]) }
    }

    /// Checks every rule of the encoding.
    pub(super) fn verify(&self) -> Result<(), MaskError> {
        let mut before = None;
        for (number, [a, b]) in (0u64..).zip(self.pairs.iter().copied()) {
            if !is_pair([a, b], self.n) {
                return Err(MaskError::NoSuchPair { word: number, row: a, bits: 1 << (b % 32) });
            }
            if before.replace([a, b]).is_some_and(|before| before >= [a, b]) {
                return Err(MaskError::NotSorted { word: number });
            }
        }
        Ok(())
    }
}

impl fmt::Debug for ListMask<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (n, pairs) = (self.n.get(), self.pairs.len());
        f.debug_struct("ListMask").field("n", &n).field("pairs", &pairs).finish()
    }
}

/// The pairs of a list that were not yet taken.
#[derive(Clone)]
pub(in crate::mask) struct ListPairs<'a> {
    n: BoxCount,
    rest: &'a [[u32; 2]],
}

impl ListPairs<'_> {
    /// Puts pairs until there is no more room. False at the end of the list.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let more = !self.rest.is_empty();
        while let Some((pair, after)) = self.rest.split_first()
            && writer.has_room_for(1)
        {
            writer.put_if(is_pair(*pair, self.n), (*pair).into());
            self.rest = after;
        }
        more
    }

    /// The next pair, as a word of one bit.
    pub fn next_word(&mut self) -> Option<AddressedWord> {
        loop {
            let (&[row, column], after) = self.rest.split_first()?;
            self.rest = after;
            if is_pair([row, column], self.n) {
                let address = WordAddress::Sparse { row, block: column / 32 };
                return Some(AddressedWord { address, bits: MaskWord(1 << (column % 32)) });
            }
        }
    }
}

/// Whether two indices are a pair of `n` boxes, smaller first.
fn is_pair([a, b]: [u32; 2], n: BoxCount) -> bool {
    a < b && b < n.get()
}
