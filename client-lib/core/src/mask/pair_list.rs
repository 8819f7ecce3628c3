//! Lists of pairs, in this process's own memory or in shared memory.

use std::slice;

use super::{MaskView, Pairs};

/// A list of pairs, such as those of a scene: smaller index first, sorted. One in shared memory is checked as it is
/// read: regardless of what another process writes there, no index is one that there cannot be.
#[derive(Clone, Copy)]
pub struct PairList<'a>(List<'a>);

#[derive(Clone, Copy)]
enum List<'a> {
    Own(&'a [[u32; 2]]),
    Shared(MaskView<'a>),
}

impl Default for PairList<'_> {
    fn default() -> Self {
        Self(List::Own(&[]))
    }
}

impl<'a> From<&'a [[u32; 2]]> for PairList<'a> {
    fn from(pairs: &'a [[u32; 2]]) -> Self {
        Self(List::Own(pairs))
    }
}

/// Those of a mask that another process may write to.
impl<'a> From<MaskView<'a>> for PairList<'a> {
    fn from(shared: MaskView<'a>) -> Self {
        Self(List::Shared(shared))
    }
}

impl<'a> PairList<'a> {
    /// How many.
    pub fn len(&self) -> usize {
        match &self.0 {
            List::Own(pairs) => pairs.len(),
            List::Shared(view) => view.count() as usize,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// The pairs one by one.
    pub fn iter(&self) -> PairListIter<'a> {
        PairListIter(match &self.0 {
            List::Own(pairs) => Pass::Own(pairs.iter()),
            List::Shared(view) => Pass::Shared(view.pairs()),
        })
    }

    /// The pairs in slices: the fastest way to iterate over all.
    pub fn for_each_slice(&self, mut f: impl FnMut(&[[u32; 2]])) {
        match &self.0 {
            List::Own([]) => {}
            List::Own(pairs) => f(pairs),
            List::Shared(view) => view.for_each_slice(f),
        }
    }

    /// The pairs where they lie, if that is this process's own memory; `None` for those in a daemon's answer.
    pub fn own_list(&self) -> Option<&'a [[u32; 2]]> {
        match &self.0 {
            List::Own(pairs) => Some(pairs),
            List::Shared(_) => None,
        }
    }

    /// The pairs.
    pub fn to_vec(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::with_capacity(self.len());
        self.for_each_slice(|some| pairs.extend_from_slice(some));
        pairs
    }
}

impl std::fmt::Debug for PairList<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<const N: usize> PartialEq<[[u32; 2]; N]> for PairList<'_> {
    fn eq(&self, pairs: &[[u32; 2]; N]) -> bool {
        self.iter().eq(*pairs)
    }
}

impl<'a> IntoIterator for &PairList<'a> {
    type Item = [u32; 2];
    type IntoIter = PairListIter<'a>;

    fn into_iter(self) -> PairListIter<'a> {
        self.iter()
    }
}

impl<'a> IntoIterator for PairList<'a> {
    type Item = [u32; 2];
    type IntoIter = PairListIter<'a>;

    fn into_iter(self) -> PairListIter<'a> {
        self.iter()
    }
}

/// The pairs of a [`PairList`], one by one.
pub struct PairListIter<'a>(Pass<'a>);

impl std::fmt::Debug for PairListIter<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PairListIter")
    }
}

#[allow(clippy::large_enum_variant)] // A pass over a list in shared memory has a buffer.
enum Pass<'a> {
    Own(slice::Iter<'a, [u32; 2]>),
    Shared(Pairs<'a>),
}

impl Iterator for PairListIter<'_> {
    type Item = [u32; 2];

    #[inline]
    fn next(&mut self) -> Option<[u32; 2]> {
        match &mut self.0 {
            Pass::Own(pairs) => pairs.next().copied(),
            Pass::Shared(pairs) => pairs.next(),
        }
    }
}
