//! What there is to test of a frame with rules at all.

use crate::filters::{FilterData, Owner, Rules, World};

/// What one pass over the filter data reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// The least and the greatest world, where there are several beside [`World::ALL`].
    pub worlds: Option<[i32; 2]>,
    /// Whether all boxes meet that share a world.
    pub world_mates_meet: bool,
    /// Whether all boxes meet.
    pub all_meet: bool,
    /// Whether any box has an owner.
    pub has_owners: bool,
}

impl Look {
    /// Looks at the filter data of the first `n` boxes.
    pub fn at(rules: &Rules, n: usize) -> Self {
        let filter_data = &rules.filter_data[..n.min(rules.filter_data.len())];
        // Boxes without filter data have the default one.
        let unfiltered = (n > filter_data.len()).then_some(FilterData::default());
        let mut all = filter_data.iter().copied().chain(unfiltered);
        let first = all.clone().next().unwrap_or_default();
        let (mut least, mut greatest) = (i32::MAX, i32::MIN);
        let (mut is_uniform, mut has_owners) = (true, false);
        for filter_data in all.by_ref() {
            if filter_data.world != World::ALL {
                least = least.min(filter_data.world.0);
                greatest = greatest.max(filter_data.world.0);
            }
            is_uniform &= filter_data.with_world(first.world) == first;
            has_owners |= filter_data.owner != Owner::NONE;
        }
        let kind_meets = rules.table.meet(first.filter, first.filter);
        let one_kind_meets = kind_meets && !first.is_static() && !has_owners;
        let worlds = (least < greatest).then_some([least, greatest]);
        let world_mates_meet = is_uniform && one_kind_meets && rules.lists.is_empty();
        Self {
            worlds,
            world_mates_meet,
            all_meet: world_mates_meet && worlds.is_none(),
            has_owners,
        }
    }
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use super::*;
    use crate::filters::{Filter, FilterTable};

    fn rules(filter_data: &[FilterData]) -> Rules {
        let mut rules = Rules::default();
        rules.filter_data = filter_data.to_vec();
        rules
    }

    fn of_world(world: i32) -> FilterData {
        FilterData::default().with_world(World(world))
    }

    #[test]
    fn rules_that_let_all_meet_are_seen() {
        assert!(Look::at(&Rules::default(), 0).all_meet);
        assert!(Look::at(&Rules::default(), 9).all_meet);
        assert!(Look::at(&rules(&[of_world(-1), of_world(4), of_world(-1)]), 3).all_meet);
        let owned = rules(&[FilterData::default().with_owner(Owner(1)), FilterData::default()]);
        assert!(!Look::at(&owned, 2).all_meet);
        assert!(!Look::at(&owned, 1).all_meet, "one owner, seen alone");
        let mut of_filter = rules(&[FilterData::default(); 3]);
        of_filter.table = FilterTable::new(&[Filter::new(1, 2)]).expect("one");
        assert!(!Look::at(&of_filter, 3).all_meet, "a kind that does not meet itself");
        of_filter.table = FilterTable::new(&[Filter::new(3, 2)]).expect("one");
        assert!(Look::at(&of_filter, 3).all_meet);
        of_filter.lists.exclude([0, 1], true);
        assert!(!Look::at(&of_filter, 3).all_meet);
        let is_static = rules(&[FilterData::default().with_static(true); 2]);
        assert!(!Look::at(&is_static, 2).all_meet);
    }

    #[test]
    fn several_worlds_are_seen_with_boxes_that_have_no_filter_data() {
        let look = |filter_data: &[FilterData], n| Look::at(&rules(filter_data), n).worlds;
        assert_eq!(look(&[of_world(-5), of_world(-1), of_world(7)], 3), Some([-5, 7]));
        assert_eq!(look(&[of_world(-5), of_world(-1), of_world(7)], 2), None);
        assert_eq!(look(&[of_world(3)], 2), Some([0, 3]));
        assert_eq!(look(&[of_world(3)], 1), None);
        assert_eq!(look(&[of_world(-1)], 1), None);
        assert!(!Look::at(&rules(&[of_world(3)]), 2).all_meet);
        assert!(Look::at(&rules(&[of_world(3)]), 2).world_mates_meet);
    }
}
