//! Bullet: filter group and mask, as `needsBroadphaseCollision` of the overlapping pair cache tests them.

use super::bits;
use crate::filters::Filter;

/// The filter of a Bullet object: its `collisionFilterGroup` and `collisionFilterMask`. Versions with 16 bits
/// of each widen them with their sign.
///
/// Bullet has no further rule for static objects: `StaticFilter` is a category, which the masks that the
/// world gives to static objects leave out.
pub const fn from_bullet(group: i32, mask: i32) -> Filter {
    Filter::new(bits(group), bits(mask))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    #[test]
    fn bullet_groups_meet_as_in_bullet() {
        let field = |random: &mut Random| (random.int(), random.int());
        let meet = |a: &(i32, i32), b: &(i32, i32)| a.0 & b.1 != 0 && b.0 & a.1 != 0;
        check(field, |&(group, mask)| from_bullet(group, mask), meet);
    }

    #[test]
    fn a_static_object_of_16_bits_meets_all_but_static_ones() {
        // The world gives StaticFilter (2) the mask AllFilter ^ StaticFilter.
        let ground = from_bullet(2, i32::from(-1i16 ^ 2));
        let ball = from_bullet(1, i32::from(-1i16));
        assert!(ground.admits(&ball) && ball.admits(&ball));
        assert!(!ground.admits(&ground));
    }
}
