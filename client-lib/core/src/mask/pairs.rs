//! Pairs of a mask, one after the other.

use std::iter::FusedIterator;

use rayon::iter::plumbing::Folder;

use super::encodings::PairSource;
use super::pair_buffer::PairBuffer;

/// The pairs [a, b] of a mask, a < b < n, from [`MaskView::pairs`](super::MaskView::pairs).
///
/// `for_each` and the other folds are faster than a `for` loop: they look at the buffer of decoded
/// pairs as a whole.
#[derive(Clone)]
pub struct Pairs<'a> {
    buffer: PairBuffer,
    source: PairSource<'a>,
}

impl<'a> Pairs<'a> {
    pub(super) fn of(source: PairSource<'a>) -> Self {
        Self { buffer: PairBuffer::new(), source }
    }

    /// Calls `f` with some of the pairs that are left, again and again until there are no more.
    ///
    /// See [`MaskView::for_each_slice`](super::MaskView::for_each_slice).
    #[inline]
    pub fn for_each_slice(mut self, mut f: impl FnMut(&[[u32; 2]])) {
        loop {
            match self.buffer.as_slice() {
                [] => {}
                some => f(some),
            }
            if !self.refill() {
                return;
            }
        }
    }

    /// Appends the pairs to a vector, a buffer at a time.
    pub(super) fn append_to(self, pairs: &mut Vec<[u32; 2]>) {
        self.for_each_slice(|some| pairs.extend_from_slice(some));
    }

    /// Hands the pairs to a folder, which is asked once a buffer whether it has enough.
    pub(super) fn feed<F: Folder<[u32; 2]>>(mut self, mut folder: F) -> F {
        loop {
            for pair in self.buffer.as_slice() {
                folder = folder.consume(*pair);
            }
            if folder.full() || !self.refill() {
                return folder;
            }
        }
    }

    /// Decodes the next pairs into the buffer. False at the end of the mask.
    #[inline(never)]
    fn refill(&mut self) -> bool {
        self.source.refill(&mut self.buffer)
    }
}

impl Iterator for Pairs<'_> {
    type Item = [u32; 2];

    #[inline]
    fn next(&mut self) -> Option<[u32; 2]> {
        loop {
            if let Some(pair) = self.buffer.take() {
                return Some(pair);
            }
            if !self.refill() {
                return None;
            }
        }
    }

    #[inline]
    fn fold<B, F: FnMut(B, [u32; 2]) -> B>(mut self, init: B, mut f: F) -> B {
        let mut acc = init;
        loop {
            for pair in self.buffer.as_slice() {
                acc = f(acc, *pair);
            }
            if !self.refill() {
                return acc;
            }
        }
    }
}

impl FusedIterator for Pairs<'_> {}
