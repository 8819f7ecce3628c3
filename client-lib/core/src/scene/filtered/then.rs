//! What rules were when the history began, as far as they are others now.

use std::collections::{HashMap, HashSet};

use super::super::pair_list::Pair;
use super::expand::Note;
use crate::filters::{FilterTable, Listed, PairLists, Rules, Tag, decide};

/// What has changed about rules since the last answer that was taken.
#[derive(Debug, Default)]
pub(super) struct Then {
    tags: HashMap<u32, Tag>,
    table: Option<FilterTable>,
    listed: HashMap<Pair, Listed>,
    removed: HashSet<u32>,
    renewed: HashSet<u32>,
}

impl Then {
    /// Whether rules are what they were.
    fn is_now(&self) -> bool {
        self.tags.is_empty() && self.table.is_none() && self.listed.is_empty()
    }

    /// Whether two boxes could be a pair.
    pub fn met(&self, rules: &Rules, a: u32, b: u32) -> bool {
        if self.is_now() {
            return rules.meet(a, b);
        }
        let tag = |index| self.tags.get(&index).copied().unwrap_or_else(|| rules.tag(index));
        let listed = || {
            let then = self.listed.get(&[a.min(b), a.max(b)]).copied();
            then.unwrap_or_else(|| rules.lists.listed(a, b))
        };
        decide(&tag(a), &tag(b), self.table.as_ref().unwrap_or(&rules.table), listed)
    }

    /// Whether a box of a pair was looked at anew.
    pub fn is_renewed(&self, [a, b]: Pair) -> bool {
        self.renewed.contains(&a) || self.renewed.contains(&b)
    }

    /// Whether a box of a pair was removed.
    pub fn is_removed(&self, [a, b]: Pair) -> bool {
        self.removed.contains(&a) || self.removed.contains(&b)
    }

    /// Whether any box was looked at anew.
    pub fn has_renewed(&self) -> bool {
        !self.renewed.is_empty()
    }

    /// The history begins anew.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.tags.capacity() * (size_of::<(u32, Tag)>() + 1)
            + self.table.as_ref().map_or(0, FilterTable::allocated_bytes)
            + self.listed.capacity() * (size_of::<(Pair, Listed)>() + 1)
            + (self.removed.capacity() + self.renewed.capacity()) * (size_of::<u32>() + 1)
    }
}

impl Note for Then {
    fn renewed(&mut self, index: u32) {
        self.renewed.insert(index);
    }

    fn removed(&mut self, index: u32, tag: Tag) {
        self.tagged(index, tag);
        self.removed.insert(index);
    }

    fn tagged(&mut self, index: u32, tag: Tag) {
        self.tags.entry(index).or_insert(tag);
    }

    fn table(&mut self, table: FilterTable) {
        self.table.get_or_insert(table);
    }

    fn listed(&mut self, [a, b]: Pair, lists: &PairLists) {
        self.listed.entry([a.min(b), a.max(b)]).or_insert_with(|| lists.listed(a, b));
    }
}
