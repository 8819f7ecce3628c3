//! A view of a mask where it lies.

use std::ops::Range;

use super::{
    DenseMask, Encoding, MaskError, MaskShape, Pairs, ParPairs, Section, Span, SparseMask, Words,
};
use crate::units::BoxCount;

impl Section {
    /// The words of a span, or which section it is that leaves the reply.
    pub(super) fn of<'a>(self, span: &Span, reply: &'a [u32]) -> Result<&'a [u32], MaskError> {
        let reply_words = reply.len() as u64;
        span.of(reply).ok_or(MaskError::OutsideReply { section: self, span: *span, reply_words })
    }
}

/// A pair mask in a reply, of either encoding: nothing is copied.
///
/// The reply is data from another process. [`MaskView::new`] checks in O(1) that the sections lie
/// in the reply and have the right lengths. Whatever the bytes, decoding then never panics, ends,
/// and gives only pairs with a < b < n: bits that name no pair of boxes are dropped.
/// [`MaskView::verify`] says whether there are any. Words are read where they lie and when they are
/// needed, so whoever published the reply must leave it alone while a view lives.
///
/// ```
/// use pairmask::BoxCount;
/// use pairmask::mask::{MaskShape, MaskView};
/// // Boxes 0 to 3. Bit k is pair k of (0,1) (0,2) (0,3) (1,2) (1,3) (2,3).
/// let n = BoxCount::new(4);
/// let reply = [0b10_0001];
/// let mask = MaskView::new(n, &MaskShape::dense(n), &reply)?;
/// assert_eq!(mask.to_vec(), [(0, 1), (2, 3)]);
/// assert!(mask.contains(3, 2));
///
/// // The same pairs as two words (row, block, bits), with room for 16.
/// let mut reply = [0; 48];
/// (reply[0], reply[16], reply[32]) = (0, 0, 0b0010);
/// (reply[1], reply[17], reply[33]) = (2, 0, 0b1000);
/// let mask = MaskView::new(n, &MaskShape::sparse(n, 2, 2, false), &reply)?;
/// assert_eq!(mask.to_vec(), [(0, 1), (2, 3)]);
/// mask.verify()?;
/// # Ok::<(), pairmask::mask::MaskError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub enum MaskView<'a> {
    /// One bit for every pair.
    Dense(DenseMask<'a>),
    /// Non-zero words with their addresses.
    Sparse(SparseMask<'a>),
}

impl<'a> MaskView<'a> {
    /// The mask of `n` boxes that lies in `reply` as `shape` says.
    ///
    /// # Errors
    /// [`MaskError`] where a section leaves the reply or a length is wrong.
    pub fn new(n: BoxCount, shape: &MaskShape, reply: &'a [u32]) -> Result<Self, MaskError> {
        match shape {
            MaskShape::Dense { words } => DenseMask::new(n, words, reply).map(Self::Dense),
            MaskShape::Sparse { rows, blocks, bits, order } => {
                SparseMask::new(n, [rows, blocks, bits], order.as_ref(), reply).map(Self::Sparse)
            }
        }
    }

    /// Number of boxes.
    #[inline]
    pub const fn n(&self) -> BoxCount {
        match self {
            Self::Dense(mask) => mask.n(),
            Self::Sparse(mask) => mask.n(),
        }
    }

    /// How the mask is written.
    #[inline]
    pub const fn encoding(&self) -> Encoding {
        match self {
            Self::Dense(_) => Encoding::Dense,
            Self::Sparse(_) => Encoding::Sparse,
        }
    }

    /// Whether there is no pair. Stops at the first one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pairs().next().is_none()
    }

    /// Number of pairs: a pass over the words.
    ///
    /// Never less than the iterators give. It is more only where an order is malformed, since the
    /// order is not read here.
    #[must_use]
    pub fn count(&self) -> u64 {
        match self {
            Self::Dense(mask) => mask.count(),
            Self::Sparse(mask) => mask.count(),
        }
    }

    /// Whether boxes `a` and `b`, in any order, are a pair of the mask. False for equal and for
    /// unknown boxes.
    ///
    /// Dense: one AND. Sparse: a binary search, behind an O(n) search if there is an order.
    #[inline]
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        match self {
            Self::Dense(mask) => mask.contains(a, b),
            Self::Sparse(mask) => mask.contains(a, b),
        }
    }

    /// The pairs (a, b), a < b < n, in the order of the words; each once.
    #[inline]
    #[must_use]
    pub fn pairs(&self) -> Pairs<'a> {
        self.pairs_in(0..self.word_count())
    }

    /// The same pairs on the threads of the current rayon pool, split by ranges of words. Where every
    /// frame is looked at so, an [`AwakePool`](crate::awake_pool::AwakePool) spares the threads' wake-up.
    #[inline]
    #[must_use]
    pub const fn par_pairs(&self) -> ParPairs<'a> {
        ParPairs::new(*self)
    }

    /// Calls `f(a, b)` for each pair: the fastest way through a mask on one thread.
    #[inline]
    pub fn for_each(&self, mut f: impl FnMut(u32, u32)) {
        self.pairs().for_each(|(a, b)| f(a, b));
    }

    /// The non-zero words with their addresses, without bits that name no pair.
    #[inline]
    #[must_use]
    pub fn words(&self) -> Words<'a> {
        match self {
            Self::Dense(mask) => Words::dense(mask.words_in(0..self.word_count())),
            Self::Sparse(mask) => Words::sparse(mask.n(), mask.words_in(0..self.word_count())),
        }
    }

    /// The pairs in a vector of their own.
    #[must_use]
    pub fn to_vec(&self) -> Vec<(u32, u32)> {
        let mut pairs = Vec::with_capacity(self.count() as usize);
        self.append_to(&mut pairs);
        pairs
    }

    /// Appends the pairs to `pairs`: faster than pushing each, and without allocating once the
    /// vector has grown to the size of a frame.
    pub fn append_to(&self, pairs: &mut Vec<(u32, u32)>) {
        self.pairs().append_to(pairs);
    }

    /// Checks every rule of the encoding, in O(words) and, with an order, O(n).
    ///
    /// Not needed for safety. A mask that passes holds what its bits say, no more and no less.
    ///
    /// # Errors
    /// The first rule broken, and where: [`MaskError`].
    pub fn verify(&self) -> Result<(), MaskError> {
        match self {
            Self::Dense(mask) => mask.verify(),
            Self::Sparse(mask) => mask.verify(),
        }
    }

    /// Words of the mask as it lies in the reply.
    pub(super) fn word_count(&self) -> usize {
        match self {
            Self::Dense(mask) => mask.as_words().len(),
            Self::Sparse(mask) => mask.word_count(),
        }
    }

    /// The pairs of a range of words.
    pub(super) fn pairs_in(&self, range: Range<usize>) -> Pairs<'a> {
        match self {
            Self::Dense(mask) => Pairs::dense(mask.pairs_in(range)),
            Self::Sparse(mask) => Pairs::sparse(mask.pairs_in(range)),
        }
    }
}
