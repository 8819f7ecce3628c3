//! Non-zero words of a mask with their addresses.

use std::iter::FusedIterator;

use super::dense_words::DenseWords;
use super::sparse_words::SparseWords;
use crate::units::{BoxCount, MaskWord, PairIndex};

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
pub struct Words<'a>(WordsOf<'a>);

#[derive(Clone)]
enum WordsOf<'a> {
    Dense(DenseWords<'a>),
    Sparse(BoxCount, SparseWords<'a>),
}

impl<'a> Words<'a> {
    pub(super) fn dense(words: DenseWords<'a>) -> Self {
        Self(WordsOf::Dense(words))
    }

    pub(super) fn sparse(n: BoxCount, words: SparseWords<'a>) -> Self {
        Self(WordsOf::Sparse(n, words))
    }
}

impl Iterator for Words<'_> {
    type Item = AddressedWord;

    #[inline]
    fn next(&mut self) -> Option<AddressedWord> {
        match &mut self.0 {
            WordsOf::Dense(words) => words.next().map(|(number, bits)| AddressedWord {
                address: WordAddress::Dense { first: PairIndex::new(32 * number as u64) },
                bits: MaskWord(bits),
            }),
            WordsOf::Sparse(n, words) => {
                let word = words.map(|word| word.without_strays(*n)).find(|word| word.bits != 0)?;
                Some(AddressedWord {
                    address: WordAddress::Sparse { row: word.row, block: word.block },
                    bits: MaskWord(word.bits),
                })
            }
        }
    }
}

impl FusedIterator for Words<'_> {}
