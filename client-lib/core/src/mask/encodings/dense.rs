//! Dense masks: one bit for every pair.

use std::fmt;
use std::ops::Range;

use super::dense_pairs::DensePairs;
use super::dense_words::DenseWords;
use crate::isa::AvailableIsa;
use crate::mask::{MaskError, Section, Span};
use crate::units::{BoxCount, PairIndex};

/// A dense mask, lengths checked: bit k%32 of word k/32 is pair k (Avril et al. 2012, §3.4).
#[derive(Clone, Copy)]
pub struct DenseMask<'a> {
    n: BoxCount,
    /// Exactly `n.dense_words()` words.
    words: &'a [u32],
    isa: AvailableIsa,
}

impl<'a> DenseMask<'a> {
    pub(super) fn new(n: BoxCount, words: &Span, reply: &'a [u32]) -> Result<Self, MaskError> {
        if words.len != n.dense_words() {
            let expected = n.dense_words();
            return Err(MaskError::DenseLength { n: n.get(), expected, found: words.len });
        }
        Ok(Self { n, words: Section::Words.of(words, reply)?, isa: AvailableIsa::best() })
    }

    /// The same mask, decoded with one instruction set.
    pub(super) const fn with_isa(self, isa: AvailableIsa) -> Self {
        Self { isa, ..self }
    }

    /// Number of boxes.
    #[inline]
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// The words as they lie in the reply, with all that is behind the last pair.
    #[inline]
    pub const fn as_words(&self) -> &'a [u32] {
        self.words
    }

    /// Whether the mask names the pair of boxes `a` and `b`, in any order: one AND.
    ///
    /// False for equal and for unknown boxes.
    #[inline]
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        PairIndex::of(self.n, a.min(b), a.max(b)).is_some_and(|k| {
            let word = self.words.get((k.get() / 32) as usize).copied().unwrap_or(0);
            word & (1 << (k.get() % 32)) != 0
        })
    }

    /// Number of pairs.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.words_in(0..self.words.len())
            .fold(0, |sum, (_, bits)| sum + u64::from(bits.count_ones()))
    }

    /// Bits of the last word that may be set.
    fn last_mask(&self) -> u32 {
        match self.n.pair_count() % 32 {
            0 => u32::MAX,
            used => !(u32::MAX << used),
        }
    }

    /// The non-zero words of a range and their numbers.
    pub(super) fn words_in(&self, range: Range<usize>) -> DenseWords<'a> {
        DenseWords::new(self.words, range, self.last_mask(), self.isa)
    }

    pub(super) fn pairs_in(&self, range: Range<usize>) -> DensePairs<'a> {
        DensePairs::new(self.n, self.words_in(range))
    }

    /// Checks every rule of the encoding.
    pub(super) fn verify(&self) -> Result<(), MaskError> {
        match self.words.last().map_or(0, |last| last & !self.last_mask()) {
            0 => Ok(()),
            bits => Err(MaskError::TailBits { bits }),
        }
    }
}

impl fmt::Debug for DenseMask<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DenseMask")
            .field("n", &self.n.get())
            .field("words", &self.words.len())
            .finish()
    }
}
