//! How an edit names boxes: by a list of indices, a range or a bitmask.

use std::ops::Range;

/// Indices of boxes.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Indices<'a> {
    /// As a list, in any order.
    List(&'a [u32]),
    /// From one index to before another.
    Range {
        /// The first one.
        first: u32,
        /// How many.
        count: u32,
    },
    /// As a bitmask: bit t of word w is index `first + 32 w + t`.
    Mask {
        /// Index of the lowest bit.
        first: u32,
        /// The bits.
        words: &'a [u32],
    },
}

impl Indices<'_> {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::List(indices) => indices.len(),
            Self::Range { count, .. } => *count as usize,
            Self::Mask { words, .. } => words.iter().map(|w| w.count_ones() as usize).sum(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The largest index, in 64 bits, since a client may name one beyond 2^32 − 1.
    pub fn last(&self) -> Option<u64> {
        match self {
            Self::List([]) | Self::Range { count: 0, .. } => None,
            // Folded, not `max`, which compares one by one.
            Self::List(indices) => Some(u64::from(indices.iter().fold(0, |most, i| most.max(*i)))),
            Self::Range { first, count } => Some(u64::from(*first) + u64::from(*count) - 1),
            Self::Mask { first, words } => {
                let (w, word) = words.iter().enumerate().rev().find(|(_, word)| **word != 0)?;
                Some(u64::from(*first) + 32 * w as u64 + 31 - u64::from(word.leading_zeros()))
            }
        }
    }

    /// Calls `f` with each index and its place among them. None may be beyond 2^32 − 1: see
    /// [`Self::last`].
    #[inline]
    pub fn for_each(&self, mut f: impl FnMut(usize, u32)) {
        match self {
            Self::List(indices) => indices.iter().enumerate().for_each(|(at, i)| f(at, *i)),
            Self::Range { first, count } => (0..*count).for_each(|at| f(at as usize, first + at)),
            Self::Mask { first, words } => {
                let mut at = 0;
                for (w, word) in words.iter().enumerate() {
                    let mut rest = *word;
                    while rest != 0 {
                        f(at, first + 32 * w as u32 + rest.trailing_zeros());
                        rest &= rest - 1;
                        at += 1;
                    }
                }
            }
        }
    }
}

impl<'a> From<&'a [u32]> for Indices<'a> {
    fn from(list: &'a [u32]) -> Self {
        Self::List(list)
    }
}

impl<'a, const N: usize> From<&'a [u32; N]> for Indices<'a> {
    fn from(list: &'a [u32; N]) -> Self {
        Self::List(list)
    }
}

impl<'a> From<&'a Vec<u32>> for Indices<'a> {
    fn from(list: &'a Vec<u32>) -> Self {
        Self::List(list)
    }
}

impl From<Range<u32>> for Indices<'_> {
    /// An end below the start is an empty range.
    fn from(range: Range<u32>) -> Self {
        Self::Range { first: range.start, count: range.end.saturating_sub(range.start) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listed(indices: Indices<'_>) -> Vec<u32> {
        let mut found = Vec::new();
        indices.for_each(|at, i| {
            assert_eq!(at, found.len());
            found.push(i);
        });
        assert_eq!((found.len(), found.is_empty()), (indices.len(), indices.is_empty()));
        assert_eq!(indices.last(), found.iter().max().map(|i| u64::from(*i)));
        found
    }

    #[test]
    fn all_ways_to_name_indices_name_the_same() {
        let mask = Indices::Mask { first: 3, words: &[0b1001, 0, 0x8000_0000] };
        assert_eq!(listed(mask), [3, 6, 98]);
        assert_eq!(listed((&[3, 6, 98]).into()), [3, 6, 98]);
        assert_eq!(listed((3..6).into()), [3, 4, 5]);
        for none in [Indices::List(&[]), Indices::Mask { first: 9, words: &[0, 0] }, (4..4).into()]
        {
            assert!(listed(none).is_empty());
        }
    }

    #[test]
    fn indices_beyond_32_bits_are_seen() {
        let mask = Indices::Mask { first: u32::MAX, words: &[2] };
        assert_eq!(mask.last(), Some(1 << 32));
        let range = Indices::Range { first: u32::MAX, count: 2 };
        assert_eq!(range.last(), Some(1 << 32));
    }
}
