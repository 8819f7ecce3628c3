//! Pairs of a mask, one after the other.

use std::iter::FusedIterator;

use super::dense_pairs::DensePairs;
use super::sparse_pairs::SparsePairs;

/// The pairs (a, b) of a mask, a < b < n, from [`MaskView::pairs`](super::MaskView::pairs).
///
/// `for_each` and the other folds are faster than a `for` loop: they choose the encoding once
/// instead of at each pair.
#[derive(Clone)]
pub struct Pairs<'a>(PairsOf<'a>);

#[derive(Clone)]
enum PairsOf<'a> {
    Dense(DensePairs<'a>),
    Sparse(SparsePairs<'a>),
}

impl<'a> Pairs<'a> {
    pub(super) fn dense(pairs: DensePairs<'a>) -> Self {
        Self(PairsOf::Dense(pairs))
    }

    pub(super) fn sparse(pairs: SparsePairs<'a>) -> Self {
        Self(PairsOf::Sparse(pairs))
    }
}

impl Iterator for Pairs<'_> {
    type Item = (u32, u32);

    #[inline]
    fn next(&mut self) -> Option<(u32, u32)> {
        match &mut self.0 {
            PairsOf::Dense(pairs) => pairs.next(),
            PairsOf::Sparse(pairs) => pairs.next(),
        }
    }

    #[inline]
    fn fold<B, F: FnMut(B, (u32, u32)) -> B>(self, init: B, f: F) -> B {
        match self.0 {
            PairsOf::Dense(pairs) => pairs.fold(init, f),
            PairsOf::Sparse(pairs) => pairs.fold(init, f),
        }
    }
}

impl FusedIterator for Pairs<'_> {}
