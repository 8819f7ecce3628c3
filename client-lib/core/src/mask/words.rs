//! Non-zero words of a mask with their addresses.

use std::iter::FusedIterator;

use super::encodings::WordSource;
use crate::units::{MaskWord, PairIndex};

/// Which pairs the 32 bits of a word are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WordAddress {
    /// Bit t is pair `first` + t.
    Dense {
        /// Index of the first pair, a multiple of 32.
        first: PairIndex,
    },
    /// Bit t is the pair of positions (`row`, 32·`block` + t).
    Sparse {
        /// Position of the row.
        row: u32,
        /// Block of 32 columns.
        block: u32,
    },
}

/// A non-zero word of a mask. Every set bit names a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AddressedWord {
    /// Which pairs it is about.
    pub address: WordAddress,
    /// One bit a pair.
    pub bits: MaskWord,
}

/// The non-zero words of a mask, from [`MaskView::words`](super::MaskView::words).
#[derive(Clone)]
pub struct Words<'a>(WordSource<'a>);

impl<'a> Words<'a> {
    pub(super) const fn of(source: WordSource<'a>) -> Self {
        Self(source)
    }
}

impl Iterator for Words<'_> {
    type Item = AddressedWord;

    #[inline]
    fn next(&mut self) -> Option<AddressedWord> {
        self.0.next()
    }
}

impl FusedIterator for Words<'_> {}
