//! Pairs of a list, checked.

use super::is_pair;
use crate::isa::AvailableIsa;
use crate::mask::pair_buffer::PairWriter;
use crate::mask::{AddressedWord, WordAddress};
use crate::units::{BoxCount, MaskWord};

/// The pairs of a list that were not yet taken, in the order of the list.
#[derive(Clone)]
pub(in crate::mask) struct ListPairs<'a> {
    n: BoxCount,
    rest: &'a [[u32; 2]],
    isa: AvailableIsa,
}

impl<'a> ListPairs<'a> {
    pub fn new(n: BoxCount, rest: &'a [[u32; 2]], isa: AvailableIsa) -> Self {
        Self { n, rest, isa }
    }

    /// Puts pairs until there is no more room. False at the end of the list.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        let (next, rest) = self.rest.split_at(writer.room().min(self.rest.len()));
        self.rest = rest;
        writer.put_checked(next, self.n, self.isa);
        !next.is_empty()
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
