//! Pairs that are reported, or never reported, regardless of what their filters say.

use std::collections::{BTreeSet, HashMap, HashSet};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Listed {
    pub is_included: bool,
    pub is_excluded: bool,
}

/// The include list and the exclude list: pairs of indices, in any order. A pair may be on both.
///
/// In a [scene](crate::scene) an entry belongs to the two boxes: it ends when either is removed. One that names
/// an index without a box waits for its first box.
#[derive(Clone, Debug, Default)]
pub struct PairLists {
    listed: HashMap<[u32; 2], Listed>,
    /// Listed pairs in both directions, from the first [removal](Self::remove_index) on: a frame's lists need none.
    partners: Option<BTreeSet<[u32; 2]>>,
    /// Indices that any pair named since they were last removed.
    named: HashSet<u32>,
    /// All indices that any pair named are below this.
    end: u64,
    /// A bit for each of them, by its low bits: most pairs are not looked up.
    sieve: Vec<u64>,
}

/// Words of the sieve: 8 KiB stay in a core's nearest cache.
const SIEVE_WORDS: usize = 1 << 10;

/// The word and the bit of an index in the sieve.
#[inline]
const fn sieved(index: u32) -> (usize, u64) {
    (index as usize / 64 % SIEVE_WORDS, 1 << (index % 64))
}

impl PairLists {
    /// Empty lists.
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether both are empty.
    pub fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// Pairs on any list.
    pub fn len(&self) -> usize {
        self.listed.len()
    }

    /// Puts a pair on the include list, or takes it off. Whether that changed anything.
    pub fn include(&mut self, pair: [u32; 2], on: bool) -> bool {
        self.put(pair, |listed| &mut listed.is_included, on)
    }

    /// Puts a pair on the exclude list, or takes it off. Whether that changed anything.
    pub fn exclude(&mut self, pair: [u32; 2], on: bool) -> bool {
        self.put(pair, |listed| &mut listed.is_excluded, on)
    }

    /// The pairs of the include list, in no order.
    pub fn included(&self) -> impl Iterator<Item = [u32; 2]> {
        self.listed.iter().filter(|(_, listed)| listed.is_included).map(|(pair, _)| *pair)
    }

    /// The pairs of the exclude list, in no order.
    pub fn excluded(&self) -> impl Iterator<Item = [u32; 2]> {
        self.listed.iter().filter(|(_, listed)| listed.is_excluded).map(|(pair, _)| *pair)
    }

    /// The pairs on any list that name one of these indices; some of them twice.
    pub(crate) fn naming(
        &self,
        indices: &[u32],
    ) -> impl Iterator<Item = ([u32; 2], Listed)> + use<> {
        let mut found = Vec::new();
        let named: HashSet<u32> =
            indices.iter().copied().filter(|index| self.named.contains(index)).collect();
        match &self.partners {
            _ if named.is_empty() => {}
            Some(partners) => {
                for index in named {
                    let own = partners.range([index, 0]..=[index, u32::MAX]);
                    found.extend(own.map(|[a, b]| (in_order([*a, *b]), self.listed(*a, *b))));
                }
            }
            None => {
                let is_named = |pair: &[u32; 2]| pair.iter().any(|index| named.contains(index));
                let own = self.listed.iter().filter(|(pair, _)| is_named(pair));
                found.extend(own.map(|(pair, listed)| (*pair, *listed)));
            }
        }
        found.into_iter()
    }

    /// An index beyond the first `n` that a listed pair names.
    pub fn beyond(&self, n: u32) -> Option<u32> {
        let pairs = (self.end > u64::from(n)).then(|| self.listed.keys().flatten());
        pairs.into_iter().flatten().copied().find(|index| *index >= n)
    }

    /// Ends all entries of an index whose box is removed. `ended` is called with each of them before.
    pub(crate) fn remove_index(&mut self, index: u32, mut ended: impl FnMut([u32; 2], Listed)) {
        if !self.named.remove(&index) {
            return;
        }
        let directed = |listed: &HashMap<[u32; 2], Listed>| {
            listed.keys().flat_map(|[a, b]| [[*a, *b], [*b, *a]]).collect()
        };
        let partners = self.partners.get_or_insert_with(|| directed(&self.listed));
        let own: Vec<[u32; 2]> = partners.range([index, 0]..=[index, u32::MAX]).copied().collect();
        for [index, other] in own {
            partners.remove(&[index, other]);
            partners.remove(&[other, index]);
            if let Some(listed) = self.listed.remove(&in_order([index, other])) {
                ended(in_order([index, other]), listed);
            }
        }
    }

    #[inline]
    pub(crate) fn listed(&self, a: u32, b: u32) -> Listed {
        if !self.listed.is_empty() && self.may_be_named(a) && self.may_be_named(b) {
            self.listed.get(&in_order([a, b])).copied().unwrap_or_default()
        } else {
            Listed::default()
        }
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.listed.capacity() * (size_of::<([u32; 2], Listed)>() + 1)
            + self.named.capacity() * (size_of::<u32>() + 1)
            // A tree's nodes are between half full and full.
            + self.partners.as_ref().map_or(0, |partners| 2 * partners.len() * size_of::<[u32; 2]>())
            + self.sieve.capacity() * size_of::<u64>()
    }

    /// Whether the sieve lets an index pass: all that any pair named, now or before, and few others.
    #[inline]
    pub(crate) fn may_be_named(&self, index: u32) -> bool {
        let (word, bit) = sieved(index);
        self.sieve.get(word).is_some_and(|word| word & bit != 0)
    }

    /// Whether any pair of the lists, now or since the index was last removed, named an index.
    pub(crate) fn is_named(&self, index: u32) -> bool {
        self.named.contains(&index)
    }

    fn put(&mut self, pair: [u32; 2], of: impl Fn(&mut Listed) -> &mut bool, on: bool) -> bool {
        let pair = in_order(pair);
        if !on && !self.listed.contains_key(&pair) {
            return false;
        }
        if on {
            self.named.extend(pair);
            self.end = self.end.max(u64::from(pair[1]) + 1);
            self.sieve.resize(SIEVE_WORDS, 0);
            for index in pair {
                let (word, bit) = sieved(index);
                self.sieve[word] |= bit;
            }
        }
        let listed = self.listed.entry(pair).or_default();
        let was = std::mem::replace(of(listed), on);
        let is_listed = *listed != Listed::default();
        if !is_listed {
            self.listed.remove(&pair);
        }
        if let Some(partners) = &mut self.partners {
            for directed in [pair, [pair[1], pair[0]]] {
                if is_listed {
                    partners.insert(directed);
                } else {
                    partners.remove(&directed);
                }
            }
        }
        was != on
    }
}

impl PartialEq for PairLists {
    /// Whether they list the same pairs.
    fn eq(&self, other: &Self) -> bool {
        self.listed == other.listed
    }
}

impl Eq for PairLists {}

pub(crate) const fn in_order([a, b]: [u32; 2]) -> [u32; 2] {
    if a < b { [a, b] } else { [b, a] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_on_either_list_or_both() {
        let mut lists = PairLists::new();
        assert!(lists.include([70, 3], true));
        assert!(!lists.include([3, 70], true), "it was on it");
        assert!(lists.exclude([3, 70], true));
        assert_eq!(lists.listed(70, 3), Listed { is_included: true, is_excluded: true });
        assert_eq!(lists.len(), 1);
        assert!(lists.include([3, 70], false));
        assert_eq!(lists.listed(3, 70), Listed { is_included: false, is_excluded: true });
        assert_eq!(lists.excluded().collect::<Vec<_>>(), [[3, 70]]);
        assert_eq!(lists.included().count(), 0);
        assert!(lists.exclude([70, 3], false));
        assert!(lists.is_empty());
        assert!(!lists.exclude([70, 3], false));
        assert_eq!(lists.listed(3, 70), Listed::default());
        assert_eq!(lists.listed(u32::MAX, 0), Listed::default());
    }

    #[test]
    fn entries_end_with_either_index() {
        let mut lists = PairLists::new();
        let remove = |lists: &mut PairLists, index| {
            let mut ended = Vec::new();
            lists.remove_index(index, |pair, _| ended.push(pair));
            ended
        };
        for pair in [[1, 2], [3, 1], [2, 3], [9, 9]] {
            lists.exclude(pair, true);
        }
        assert_eq!(remove(&mut lists, 1), [[1, 2], [1, 3]]);
        assert!(!lists.is_named(1) && lists.is_named(2));
        // Entries that come after the first removal end as well.
        lists.include([4, 2], true);
        lists.include([2, 5], true);
        lists.include([5, 2], false);
        assert_eq!(remove(&mut lists, 2), [[2, 3], [2, 4]]);
        assert_eq!(remove(&mut lists, 2), [[0; 2]; 0]);
        assert_eq!(lists.excluded().collect::<Vec<_>>(), [[9, 9]]);
        assert_eq!(remove(&mut lists, 9), [[9, 9]]);
        assert!(lists.is_empty());
    }
}
