//! The kinds of a frame's boxes, and which of them meet.

use crate::filters::{FilterId, Rules, Tag};

/// Kinds up to which each block of columns has a word a kind: those of its columns that the kind meets.
/// Memory is as much as a bit a box and kind.
pub const MOST_KINDS: usize = 32;

/// The kinds of a frame's boxes: a filter, and whether the box is static.
pub struct Kinds {
    /// The kinds by rising number.
    kinds: Vec<(FilterId, bool)>,
    /// The kind of each filter, of boxes that are not static and of those that are.
    by_filter: Vec<[Option<u8>; 2]>,
}

impl Kinds {
    /// The kinds of some tags, and that of each tag. `None` where there are too many.
    pub fn of(
        rules: &Rules,
        tags: impl Iterator<Item = Tag>,
        kind_of: &mut Vec<u8>,
    ) -> Option<Self> {
        // Filters that are not in the table are one more kind: all of them meet everything.
        let beyond = rules.table.filters().len();
        let mut all = Self { kinds: Vec::new(), by_filter: vec![[None; 2]; beyond + 1] };
        kind_of.clear();
        for tag in tags {
            let at = usize::from(tag.filter.0).min(beyond);
            let kind = match all.by_filter[at][usize::from(tag.is_static())] {
                Some(kind) => kind,
                None if all.kinds.len() == MOST_KINDS => return None,
                None => {
                    let kind = all.kinds.len() as u8;
                    all.kinds.push((tag.filter, tag.is_static()));
                    all.by_filter[at][usize::from(tag.is_static())] = Some(kind);
                    kind
                }
            };
            kind_of.push(kind);
        }
        Some(all)
    }

    /// For each kind, a bit for each that it meets.
    pub fn meets(&self, rules: &Rules) -> Vec<u32> {
        let is_static = |(id, of_box): (FilterId, bool)| of_box || rules.table.get(id).is_static;
        let meet = |a: (FilterId, bool), b: (FilterId, bool)| {
            rules.table.meet(a.0, b.0) && !(is_static(a) && is_static(b))
        };
        let row = |a: &(FilterId, bool)| {
            let bits = (0..).zip(&self.kinds);
            bits.fold(0, |row, (bit, b)| row | u32::from(meet(*a, *b)) << bit)
        };
        self.kinds.iter().map(row).collect()
    }
}
