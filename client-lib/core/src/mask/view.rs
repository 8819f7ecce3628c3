//! A view of a mask where it lies.

use super::{MaskError, MaskView, Pairs, ParPairs, Section, Span};

impl Section {
    /// The words of a span, or which section it is that leaves the reply.
    pub(super) fn of<'a>(self, span: &Span, reply: &'a [u32]) -> Result<&'a [u32], MaskError> {
        let reply_words = reply.len() as u64;
        span.of(reply).ok_or(MaskError::OutsideReply { section: self, span: *span, reply_words })
    }
}

impl<'a> MaskView<'a> {
    /// Whether there is no pair. Stops at the first one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pairs().next().is_none()
    }

    /// The pairs (a, b), a < b < n, in the order of the words; each once.
    #[inline]
    #[must_use]
    pub fn pairs(&self) -> Pairs<'a> {
        self.pairs_in(0..self.word_count())
    }

    /// The same pairs on the threads of the current rayon pool, split by ranges of words.
    #[inline]
    #[must_use]
    pub const fn par_pairs(&self) -> ParPairs<'a> {
        ParPairs::new(*self)
    }

    /// Calls `f(a, b)` for each pair: the fastest way through a mask on one thread.
    #[inline]
    pub fn for_each(&self, mut f: impl FnMut(u32, u32)) {
        self.pairs().for_each(|[a, b]| f(a, b));
    }

    /// Calls `f` with slices of pairs [a, b], a < b < n, none of them empty: all pairs, in the order of
    /// [`pairs`](Self::pairs). For those who copy pairs, or work on several at a time.
    ///
    /// A slice lies in a buffer of 2 KiB, in the first-level cache. A list, too, is copied there and
    /// the copy checked, since another process may write to the list itself at any time.
    #[inline]
    pub fn for_each_slice(&self, f: impl FnMut(&[[u32; 2]])) {
        self.pairs().for_each_slice(f);
    }

    /// The pairs in a vector of their own.
    #[must_use]
    pub fn to_vec(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::with_capacity(self.count() as usize);
        self.append_to(&mut pairs);
        pairs
    }

    /// Appends the pairs to `pairs`: faster than pushing each, and without allocating once the
    /// vector has grown to the size of a frame.
    pub fn append_to(&self, pairs: &mut Vec<[u32; 2]>) {
        self.pairs().append_to(pairs);
    }
}
