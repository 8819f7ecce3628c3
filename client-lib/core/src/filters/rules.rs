//! Whether two boxes may be a pair.

use super::pair_lists::{Listed, PairLists};
use super::table::FilterTable;
use super::tag::{Owner, Tag, World};

/// The tags of boxes by index, and what decides of them.
///
/// ```
/// use pairmask_core::filters::{Owner, Rules, Tag, World};
///
/// let mut rules = Rules::default();
/// rules.tags = vec![Tag::default().with_owner(Owner(7)); 3];
/// rules.tags[2] = Tag::default().with_world(World::ALL);
/// assert!(!rules.meet(0, 1), "one owner");
/// assert!(rules.meet(0, 2));
/// rules.lists.include([1, 0], true);
/// assert!(rules.meet(0, 1));
/// ```
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Rules {
    /// Tags by index. An index beyond them has [`Tag::default`].
    pub tags: Vec<Tag>,
    /// The filters that tags name.
    pub table: FilterTable,
    /// Pairs with rules of their own.
    pub lists: PairLists,
}

impl Rules {
    /// The tag of a box.
    #[inline]
    pub fn tag(&self, index: u32) -> Tag {
        self.tags.get(index as usize).copied().unwrap_or_default()
    }

    /// Whether the boxes of two indices may be a pair.
    #[inline]
    pub fn meet(&self, a: u32, b: u32) -> bool {
        decide(&self.tag(a), &self.tag(b), &self.table, || self.lists.listed(a, b))
    }

    /// Whether boxes of two tags may be a pair, where no list says anything of them.
    pub fn tags_meet(&self, a: &Tag, b: &Tag) -> bool {
        decide(a, b, &self.table, Listed::default)
    }

    /// Whether all of the first `n` boxes meet, as far as a look tells that ends at the first box that is
    /// not like the one before.
    pub fn let_all_meet(&self, n: usize) -> bool {
        let tags = &self.tags[..n.min(self.tags.len())];
        let untagged = (n > tags.len()).then_some(Tag::default());
        let mut world = World::ALL;
        let mut is_of_one_world = |tag: &Tag| {
            if world == World::ALL {
                world = tag.world;
            }
            tag.world.meets(world)
        };
        let first = tags.first().copied().unwrap_or_default();
        let is_alike = |tag: &Tag| tag.with_world(first.world) == first;
        first.owner == Owner::NONE
            && !first.is_static()
            && self.lists.is_empty()
            && self.table.meet(first.filter, first.filter)
            && tags.iter().chain(&untagged).all(|tag| is_alike(tag) && is_of_one_world(tag))
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.tags.capacity() * size_of::<Tag>()
            + self.table.allocated_bytes()
            + self.lists.allocated_bytes()
    }
}

/// Whether boxes with two tags may be a pair, by the order of the [module](crate::filters).
#[inline]
pub(crate) fn decide(
    a: &Tag,
    b: &Tag,
    table: &FilterTable,
    listed: impl FnOnce() -> Listed,
) -> bool {
    if !a.world.meets(b.world) {
        return false;
    }
    let is_static = |tag: &Tag| tag.is_static() || table.get(tag.filter).is_static;
    let are_static = (a.is_static() || b.is_static()) && is_static(a) && is_static(b);
    let are_of_one = a.owner == b.owner && a.owner != Owner::NONE;
    let passes = !are_of_one && !are_static && table.meet(a.filter, b.filter);
    let listed = listed();
    listed.is_included || passes && !listed.is_excluded
}
