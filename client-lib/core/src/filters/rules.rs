//! Whether two boxes may be a pair.

use super::filter_data::{FilterData, Owner, World};
use super::pair_lists::{Listed, PairLists};
use super::table::FilterTable;

/// The filter data of boxes by index, and what decides whether they meet.
///
/// ```
/// use pairmask_core::filters::{Owner, Rules, FilterData, World};
///
/// let mut rules = Rules::default();
/// rules.filter_data = vec![FilterData::default().with_owner(Owner(7)); 3];
/// rules.filter_data[2] = FilterData::default().with_world(World::ALL);
/// assert!(!rules.meet(0, 1), "one owner");
/// assert!(rules.meet(0, 2));
/// rules.lists.include([1, 0], true);
/// assert!(rules.meet(0, 1));
/// ```
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Rules {
    /// Filter data by index. An index beyond it has [`FilterData::default`]. A frame's rules have filter data for each
    /// box, or for none.
    pub filter_data: Vec<FilterData>,
    /// The filters that filter data names.
    pub table: FilterTable,
    /// Pairs with rules of their own.
    pub lists: PairLists,
}

impl Rules {
    /// The filter data of a box.
    #[inline]
    pub fn filter_data(&self, index: u32) -> FilterData {
        self.filter_data.get(index as usize).copied().unwrap_or_default()
    }

    /// Whether the boxes of two indices may be a pair.
    #[inline]
    pub fn meet(&self, a: u32, b: u32) -> bool {
        decide(&self.filter_data(a), &self.filter_data(b), &self.table, || self.lists.listed(a, b))
    }

    /// Whether boxes with two sets of filter data may be a pair, where no list says anything of them.
    pub fn may_meet(&self, a: &FilterData, b: &FilterData) -> bool {
        decide(a, b, &self.table, Listed::default)
    }

    /// Whether all of the first `n` boxes meet, as far as a look shows that ends at the first box that is
    /// not like the one before.
    pub fn let_all_meet(&self, n: usize) -> bool {
        let filter_data = &self.filter_data[..n.min(self.filter_data.len())];
        let unfiltered = (n > filter_data.len()).then_some(FilterData::default());
        let mut world = World::ALL;
        let mut is_of_one_world = |filter_data: &FilterData| {
            if world == World::ALL {
                world = filter_data.world;
            }
            filter_data.world.meets(world)
        };
        let first = filter_data.first().copied().unwrap_or_default();
        let is_alike = |filter_data: &FilterData| filter_data.with_world(first.world) == first;
        first.owner == Owner::NONE
            && !first.is_static()
            && self.lists.is_empty()
            && self.table.meet(first.filter, first.filter)
            && filter_data
                .iter()
                .chain(&unfiltered)
                .all(|filter_data| is_alike(filter_data) && is_of_one_world(filter_data))
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.filter_data.capacity() * size_of::<FilterData>()
            + self.table.allocated_bytes()
            + self.lists.allocated_bytes()
    }
}

/// Whether boxes with two sets of filter data may be a pair, by the order of the [module](crate::filters).
#[inline]
pub(crate) fn decide(
    a: &FilterData,
    b: &FilterData,
    table: &FilterTable,
    listed: impl FnOnce() -> Listed,
) -> bool {
    if !a.world.meets(b.world) {
        return false;
    }
    let is_static = |filter_data: &FilterData| {
        filter_data.is_static() || table.get(filter_data.filter).is_static
    };
    let are_static = (a.is_static() || b.is_static()) && is_static(a) && is_static(b);
    let are_of_one = a.owner == b.owner && a.owner != Owner::NONE;
    let passes = !are_of_one && !are_static && table.meet(a.filter, b.filter);
    let listed = listed();
    listed.is_included || passes && !listed.is_excluded
}
