//! Newton: collision groups, as `test_group_pair` of its broad phases tests them.

use crate::filters::Filter;

/// Category of positive groups.
const POSITIVE: u64 = 1;
/// Category of negative groups.
const NEGATIVE: u64 = 2;

/// The filter of a Newton shape: its `shape_collision_group`, and whether its flags have `COLLIDE_SHAPES`.
///
/// A positive group meets itself and all negative ones; a negative group meets all but itself; 0 meets
/// nothing. There may be any number of groups, one filter each.
///
/// Newton puts the shapes of one body on its list of excluded pairs, those of the world (body −1) too:
/// give them one [owner](super::owner_of), and mark those of body −1 [static](Filter::with_static). It also drops
/// pairs of two shapes that nothing moves, such as those of kinematic bodies: mark these static as well.
pub const fn from_newton(group: i32, collides: bool) -> Filter {
    if !collides || group == 0 {
        return Filter::NONE;
    }
    let (category, mask) =
        if group > 0 { (POSITIVE, NEGATIVE) } else { (NEGATIVE, POSITIVE | NEGATIVE) };
    Filter::new(category, mask).with_group(group)
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use super::*;
    use crate::filters::engines::testing::{Random, check};
    use crate::filters::{FilterData, FilterId, FilterTable, Owner, Rules, World};

    fn groups_meet(a: i32, b: i32) -> bool {
        if a == 0 || b == 0 {
            return false;
        }
        if a > 0 { a == b || b < 0 } else { a != b }
    }

    #[test]
    fn newton_groups_meet_as_in_newton() {
        let field = |random: &mut Random| (random.small(), random.flag());
        let meet = |a: &(i32, bool), b: &(i32, bool)| a.1 && b.1 && groups_meet(a.0, b.0);
        check(field, |&(group, collides)| from_newton(group, collides), meet);
    }

    #[test]
    fn newton_worlds_and_groups_meet_as_in_newton() {
        let mut random = Random(7 << 40);
        let shapes: Vec<(i32, i32)> =
            (0..60).map(|_| (random.small().rem_euclid(4) - 1, random.small())).collect();
        let filters: Vec<Filter> = shapes.iter().map(|shape| from_newton(shape.1, true)).collect();
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&filters).expect("few filters");
        rules.filter_data = (0..)
            .zip(&shapes)
            .map(|(at, shape)| FilterData::new(World(shape.0), Owner::NONE, FilterId(at)))
            .collect();
        for (a, one) in (0..).zip(&shapes) {
            for (b, other) in (0..).zip(&shapes) {
                let worlds = one.0 == -1 || other.0 == -1 || one.0 == other.0;
                let expected = worlds && groups_meet(one.1, other.1);
                assert_eq!(rules.meet(a, b), expected, "{one:?} and {other:?}");
            }
        }
    }
}
