//! Box2D and Box3D: `b2Filter`, as `b2ShouldShapesCollide` and the broad phase's trees by body type test it.

use crate::filters::Filter;

/// The filter of a Box2D or Box3D shape: its category bits, mask bits and group index. Version 2 has 16 bits
/// of each: they are widened, the group with its sign.
///
/// Equal groups other than 0 decide by their sign. Two bodies of which none is dynamic never meet. Shapes of
/// one body share its [owner](super::owner_of).
pub const fn from_box2d(category: u64, mask: u64, group: i32, is_dynamic: bool) -> Filter {
    Filter::new(category, mask).with_group(group).with_static(!is_dynamic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    #[test]
    fn box2d_filters_meet_as_in_box2d() {
        type Field = (u64, u64, i32, bool);
        let field =
            |random: &mut Random| (random.long(), random.long(), random.small(), random.flag());
        let meet = |a: &Field, b: &Field| {
            if !a.3 && !b.3 {
                return false;
            }
            if a.2 == b.2 && a.2 != 0 {
                return a.2 > 0;
            }
            (a.1 & b.0) != 0 && (a.0 & b.1) != 0
        };
        check(
            field,
            |&(category, mask, group, is_dynamic)| from_box2d(category, mask, group, is_dynamic),
            meet,
        );
    }
}
