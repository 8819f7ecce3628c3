//! What a bridge says of a box: all that decides whether it is a pair with another one, and its user data.

use pairmask_core::aabb::{Aabb, BoxClass};
use pairmask_core::filters::{Filter, FilterData, Owner};

/// A box as its writer has set it. Two are equal where their bytes are.
#[derive(Clone, Copy, Debug)]
pub struct BoxState {
    /// The box, in its writer's bits.
    pub aabb: Aabb,
    /// Its filter data.
    pub filter_data: FilterData,
    /// Its filter: what its own machine's table has at the place that the filter data name.
    pub filter: Filter,
    /// Its user data.
    pub user_data: u64,
    /// Whether it is enabled.
    pub is_enabled: bool,
}

impl From<Aabb> for BoxState {
    fn from(aabb: Aabb) -> Self {
        let (filter_data, filter) = (FilterData::default(), Filter::ALL);
        Self { aabb, filter_data, filter, user_data: 0, is_enabled: true }
    }
}

impl PartialEq for BoxState {
    fn eq(&self, other: &Self) -> bool {
        bytemuck::bytes_of(&self.aabb) == bytemuck::bytes_of(&other.aabb) && self.is_like(other)
    }
}

impl Eq for BoxState {}

impl BoxState {
    /// Whether all but the box is the same.
    pub fn is_like(&self, other: &Self) -> bool {
        self.filter_data == other.filter_data
            && self.filter == other.filter
            && self.user_data == other.user_data
            && self.is_enabled == other.is_enabled
    }

    /// Whether it may be a pair with anything.
    pub fn is_there(&self) -> bool {
        self.is_enabled && self.aabb.class() == BoxClass::Valid
    }

    /// Whether two boxes are a pair.
    pub fn meets(&self, other: &Self) -> bool {
        self.is_there()
            && other.is_there()
            && self.aabb.overlaps(&other.aabb)
            && self.may_meet(other)
    }

    /// Whether their filters let them meet, in the [order](pairmask_core::filters) of a scene without pair lists: each
    /// filter is its own machine's, so that tables may differ, and change at any tick.
    fn may_meet(&self, other: &Self) -> bool {
        let [a, b] = [self, other].map(|of| of.filter_data);
        let is_static = |of: &Self| of.filter_data.is_static() || of.filter.is_static;
        a.world.meets(b.world)
            && (a.owner != b.owner || a.owner == Owner::NONE)
            && !(is_static(self) && is_static(other))
            && self.filter.admits(&other.filter)
    }

    /// The lower corner of the intersection of two boxes that overlap, on an axis.
    pub fn corner_with(&self, other: &Self, axis: usize) -> f32 {
        self.aabb.min[axis].max(other.aabb.min[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pairmask_core::filters::{FilterId, FilterTable, Rules, World};

    #[test]
    fn boxes_meet_as_in_one_scene() {
        let filters: Vec<Filter> = (0..64)
            .map(|i: u64| {
                let filter = Filter::new(i % 5, i % 7).with_group((i % 4) as i32 - 2);
                filter.with_static(i.is_multiple_of(3)).with_either(i % 8 < 4)
            })
            .collect();
        let table = FilterTable::new(&filters).expect("64");
        let mut rules = Rules::default();
        rules.table = table;
        let states: Vec<BoxState> = (0..256_u32)
            .map(|i| {
                let (world, owner) = (World((i % 3) as i32 - 1), Owner(i / 3 % 3));
                let filter_data = FilterData::new(world, owner, FilterId((i * 7 % 65) as u16));
                let filter_data = filter_data.with_static(i % 5 == 0);
                let filter = rules.table.get(filter_data.filter);
                let aabb = Aabb::new([0.0; 3], [1.0; 3]);
                BoxState { filter_data, filter, ..BoxState::from(aabb) }
            })
            .collect();
        let mut met = 0;
        for (a, b) in states.iter().flat_map(|a| states.iter().map(move |b| (a, b))) {
            assert_eq!(a.meets(b), rules.may_meet(&a.filter_data, &b.filter_data), "{a:?} {b:?}");
            met += usize::from(a.meets(b));
        }
        assert!(met > 1_000 && met < 32_768, "{met}");
    }
}
