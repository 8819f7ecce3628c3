//! Jolt: object layers, as `ObjectLayerPairFilterTable` tests them, and collision groups, as
//! `CollisionGroup::CanCollide` and `GroupFilterTable` do.

use std::collections::HashMap;

use super::{from_relation, owner_of};
use crate::filters::{FilterTable, Owner, PairLists};

/// The filters of Jolt's object layers `0..layer_count` by id, where a table decides: `collides` is its
/// `ShouldCollide`, asked once for each two layers.
///
/// Two bodies of which none is dynamic never meet, sensors aside: mark those bodies'
/// [filter data static](crate::filters::FilterData::with_static), or, in a scene, their boxes (`Step::Static`). `None` where more than
/// 64 layers differ in what they collide with.
pub fn from_jolt_layers(
    layer_count: u16,
    collides: impl Fn(u16, u16) -> bool,
) -> Option<FilterTable> {
    from_relation(layer_count, collides)
}

/// The `CollisionGroup` of a Jolt body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoltGroup {
    /// Its group id. `u32::MAX` is `cInvalidGroup`: in no group.
    pub group: u32,
    /// Its sub group.
    pub sub_group: u32,
    /// Which group filter it has: a number for each `GroupFilterTable` of the host, or none.
    pub filter: Option<u32>,
}

impl JoltGroup {
    /// The group of a body that was given none.
    pub const NONE: Self = Self { group: u32::MAX, sub_group: u32::MAX, filter: None };
}

/// The owners of bodies in Jolt's collision groups, and the pairs that the groups keep apart.
///
/// `groups` has the group of each body by index. `collides` says of a filter and two different sub groups
/// whether its table lets them collide. A group of which no two collide becomes an owner; of others the pairs
/// that do not are on the exclude list.
pub fn from_jolt_groups(
    groups: &[JoltGroup],
    collides: impl Fn(u32, [u32; 2]) -> bool,
) -> (Vec<Owner>, PairLists) {
    let mut owners = vec![Owner::NONE; groups.len()];
    let mut lists = PairLists::new();
    let mut members: HashMap<u32, Vec<u32>> = HashMap::new();
    for (index, group) in (0..).zip(groups) {
        if group.group != u32::MAX {
            members.entry(group.group).or_default().push(index);
        }
    }
    for (group, members) in members {
        let apart = |a: u32, b: u32| {
            let [one, other] = [a, b].map(|index| groups[index as usize]);
            match (one.filter, other.filter) {
                (None, None) => false,
                (Some(filter), Some(of_other)) if filter == of_other => {
                    one.sub_group == other.sub_group
                        || !collides(filter, [one.sub_group, other.sub_group])
                }
                _ => true,
            }
        };
        let pairs = || {
            let after = |at: usize| members[at + 1..].iter();
            members.iter().enumerate().flat_map(move |(at, a)| after(at).map(|b| [*a, *b]))
        };
        if pairs().all(|[a, b]| apart(a, b)) {
            for index in members {
                owners[index as usize] = owner_of(group);
            }
        } else {
            for pair in pairs().filter(|[a, b]| apart(*a, *b)) {
                lists.exclude(pair, true);
            }
        }
    }
    (owners, lists)
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use super::*;
    use crate::filters::engines::testing::Random;
    use crate::filters::{FilterData, FilterId, Rules, World};

    #[test]
    fn jolt_layers_of_a_table_meet_as_it_says() {
        let mut random = Random(5 << 40);
        let enabled: Vec<bool> = (0..50 * 50).map(|_| random.flag()).collect();
        let collides = |a: u16, b: u16| {
            let (low, high) = (a.min(b), a.max(b));
            enabled[usize::from(high) * 50 + usize::from(low)]
        };
        let table = from_jolt_layers(50, collides).expect("50 layers");
        for a in 0..50 {
            for b in 0..50 {
                assert_eq!(table.meet(FilterId(a), FilterId(b)), collides(a, b), "{a} and {b}");
            }
        }
    }

    /// Whether the tables of two filters let sub groups collide: those of a third of all two do not.
    fn enabled(filter: u32, [a, b]: [u32; 2]) -> bool {
        filter == 9 || !(a.min(b) * 7 + a.max(b) * 3 + filter).is_multiple_of(3)
    }

    fn can_collide(a: &JoltGroup, b: &JoltGroup) -> bool {
        let by_table = |filter: u32, a: &JoltGroup, b: &JoltGroup| {
            if a.group == u32::MAX || a.group != b.group {
                return true;
            }
            if a.filter != b.filter || a.sub_group == b.sub_group {
                return false;
            }
            enabled(filter, [a.sub_group, b.sub_group])
        };
        match (a.filter, b.filter) {
            (Some(filter), _) => by_table(filter, a, b),
            (None, Some(filter)) => by_table(filter, b, a),
            (None, None) => true,
        }
    }

    #[test]
    fn jolt_groups_meet_as_in_jolt() {
        let mut random = Random(13 << 40);
        let (mut apart, mut owned) = (0, 0);
        for _ in 0..20 {
            let mut groups: Vec<JoltGroup> = (0..40)
                .map(|_| JoltGroup {
                    group: [0, 1, 2, u32::MAX - 1, u32::MAX][random.next() as usize % 5],
                    sub_group: random.next() as u32 % 4,
                    filter: [None, Some(0), Some(9)][random.next() as usize % 3],
                })
                .collect();
            // A group in which all are of one sub group.
            groups.extend([JoltGroup { group: 77, sub_group: 1, filter: Some(0) }; 5]);
            let (owners, lists) = from_jolt_groups(&groups, enabled);
            let mut rules = Rules::default();
            rules.filter_data =
                owners.iter().map(|owner| FilterData::new(World(0), *owner, FilterId(0))).collect();
            rules.lists = lists;
            owned += owners.iter().filter(|owner| **owner != Owner::NONE).count();
            for (a, one) in (0..).zip(&groups) {
                for (b, other) in (0..).zip(&groups).filter(|(b, _)| *b != a) {
                    let expected = can_collide(one, other);
                    assert_eq!(rules.meet(a, b), expected, "{one:?} and {other:?}");
                    apart += usize::from(!expected);
                }
            }
        }
        assert!(apart > 100 && owned >= 100, "{apart} apart, {owned} owned");
    }
}
