//! Lists: the pairs themselves.

mod check;
mod pairs;

pub(in crate::mask) use self::pairs::ListPairs;

use std::fmt;
use std::ops::Range;

use crate::isa::AvailableIsa;
use crate::mask::pair_check::are_pairs;
use crate::mask::{MaskError, Section, Span};
use crate::units::BoxCount;

/// A list of pairs, smaller index first, in the order in which the engine found them.
#[derive(Clone, Copy)]
pub struct ListMask<'a> {
    n: BoxCount,
    pairs: &'a [[u32; 2]],
    isa: AvailableIsa,
}

impl<'a> ListMask<'a> {
    pub(super) fn new(n: BoxCount, pairs: &Span, reply: &'a [u32]) -> Result<Self, MaskError> {
        match Section::Pairs.of(pairs, reply)?.as_chunks() {
            (pairs, []) => Ok(Self { n, pairs, isa: AvailableIsa::best() }),
            _ => Err(MaskError::HalfPair { words: pairs.len }),
        }
    }

    /// The same list, read with one instruction set.
    pub(super) const fn with_isa(self, isa: AvailableIsa) -> Self {
        Self { isa, ..self }
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

    /// Whether the list holds nothing, not even a malformed pair.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The list as it lies in the reply. Another process may have written anything there:
    /// [`MaskView::for_each_slice`](crate::mask::MaskView::for_each_slice) gives checked pairs.
    #[inline]
    pub const fn as_pairs(&self) -> &'a [[u32; 2]] {
        self.pairs
    }

    /// [`MaskView::for_each_slice`](crate::mask::MaskView::for_each_slice) without a copy: the slices
    /// lie in the list itself, and are checked there before they are given out. So it is for memory that
    /// no other process can write to, which might change a pair after it was looked at.
    pub fn for_each_slice_in_place(&self, mut f: impl FnMut(&'a [[u32; 2]])) {
        for some in self.pairs.chunks(STRETCH) {
            if are_pairs(some, self.n, self.isa) {
                f(some);
            } else {
                let runs = some.split(|pair| !is_pair(*pair, self.n));
                runs.filter(|run| !run.is_empty()).for_each(&mut f);
            }
        }
    }

    /// Whether the list names the pair of boxes `a` and `b`, in any order of the two: a pass over the
    /// list, which ends at the pair.
    #[must_use]
    pub fn contains(&self, a: u32, b: u32) -> bool {
        let requested = [a.min(b), a.max(b)];
        // A stretch without a branch is vector code.
        let is_in = |pairs: &[[u32; 2]]| {
            pairs.iter().map(|pair| u32::from(*pair == requested)).sum::<u32>() != 0
        };
        is_pair(requested, self.n) && self.pairs.chunks(STRETCH).any(is_in)
    }

    /// Number of well-formed pairs.
    #[must_use]
    pub fn count(&self) -> u64 {
        let count = |pairs: &[[u32; 2]]| {
            pairs.iter().fold(0, |sum: u32, pair| sum + u32::from(is_pair(*pair, self.n)))
        };
        self.pairs.chunks(STRETCH).map(|pairs| u64::from(count(pairs))).sum()
    }

    pub(super) fn pairs_in(&self, range: Range<usize>) -> ListPairs<'a> {
        ListPairs::new(self.n, self.pairs.get(range).unwrap_or(&[]), self.isa)
    }

    /// Checks every rule of the encoding.
    pub(super) fn verify(&self) -> Result<(), MaskError> {
        check::verify(self.n, self.pairs)
    }
}

/// Pairs that are looked at without a branch: 4 KiB, so that a search ends soon after its pair.
const STRETCH: usize = 512;

/// Whether two indices are a pair of `n` boxes, smaller first.
#[inline(always)]
const fn is_pair([a, b]: [u32; 2], n: BoxCount) -> bool {
    (a < b) & (b < n.get())
}

impl fmt::Debug for ListMask<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (n, pairs) = (self.n.get(), self.pairs.len());
        f.debug_struct("ListMask").field("n", &n).field("pairs", &pairs).finish()
    }
}
