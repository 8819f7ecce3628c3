//! Engines whose filters are categories and masks.

use super::{bits, filter_of_32};
use crate::filters::Filter;

/// The filter of a Rapier collider: the memberships and the filter of its `collision_groups`, as
/// `src/geometry/interaction_groups.rs` tests them.
///
/// `is_or` says whether their test mode is `Or`: it counts where both say so, as in Rapier since 0.27. By
/// default Rapier lets no pair of bodies meet of which none is dynamic (`ActiveCollisionTypes`).
/// Colliders of one body share its [owner](super::owner_of). Solver groups do not matter to a broad phase.
pub const fn from_rapier(memberships: u32, filter: u32, is_or: bool, is_dynamic: bool) -> Filter {
    filter_of_32(memberships, filter).with_either(is_or).with_static(!is_dynamic)
}

/// The filter of an avian collider: the bits of its `CollisionLayers`, as `interacts_with` of
/// `src/collision/collider/layers.rs` tests them, and whether its body is `RigidBody::Static`.
///
/// Colliders of one body share its [owner](super::owner_of).
pub const fn from_avian(memberships: u32, filters: u32, is_static: bool) -> Filter {
    filter_of_32(memberships, filters).with_static(is_static)
}

/// The filter of a Box2D or Box3D shape: the category bits, mask bits and group index of its `b2Filter`, as
/// `b2ShouldShapesCollide` and the broad phase's trees by body type test it. Version 2 has 16 bits of each: they
/// are widened, the group with its sign.
///
/// Equal groups other than 0 decide by their sign. Two bodies of which none is dynamic never meet. Shapes of
/// one body share its [owner](super::owner_of).
pub const fn from_box2d(category: u64, mask: u64, group: i32, is_dynamic: bool) -> Filter {
    Filter::new(category, mask).with_group(group).with_static(!is_dynamic)
}

/// The filter of a Bullet object: its `collisionFilterGroup` and `collisionFilterMask`, as
/// `needsBroadphaseCollision` of the overlapping pair cache tests them. Versions with 16 bits of each widen them
/// with their sign.
///
/// Bullet has no further rule for static objects: `StaticFilter` is a category, which the masks that the
/// world gives to static objects leave out.
pub const fn from_bullet(group: i32, mask: i32) -> Filter {
    Filter::new(bits(group), bits(mask))
}

/// The filter of a Jolt body whose object layer holds group and mask bits, as `sGetGroup` and `sGetMask` of
/// `ObjectLayerPairFilterMask` give them.
pub const fn from_jolt_mask(group: u32, mask: u32, is_dynamic: bool) -> Filter {
    filter_of_32(group, mask).with_static(!is_dynamic)
}

/// Category of triggers of PhysX, beside the 32 of the groups.
const TRIGGER: u64 = 1 << 32;

/// The filter of a PhysX shape under `PxDefaultSimulationFilterShader`, with its operations as they are by
/// default: the groups' table alone decides.
///
/// `group` is `word0`, below 32. `meets` has a bit for each group that it may meet, as `PxGetGroupCollisionFlag`
/// says. Two bodies of which none is dynamic never meet, as the scene's filtering modes say unless they are
/// `eKEEP`. A trigger meets shapes of all bodies, regardless of what the groups and the modes say, and no other trigger. So
/// one of a static actor meets static shapes too, of which PhysX says nothing: two that never move. `None` where
/// the group is none of the 32.
pub const fn from_physx_group(
    group: u32,
    meets: u32,
    is_trigger: bool,
    is_dynamic: bool,
) -> Option<Filter> {
    if group >= 32 {
        return None;
    }
    Some(if is_trigger {
        Filter::new(TRIGGER, !TRIGGER)
    } else {
        Filter::new(1 << group, TRIGGER | meets as u64).with_static(!is_dynamic)
    })
}

/// The filter of a PhysX shape under `PxDefaultSimulationFilterShader` with the operations `OR`, `OR`,
/// `SWAP_AND`, constants 0 and the filter bool true: two shapes meet where one's `word2` has a bit of the
/// other's `word3`. All groups have to meet each other in the table.
pub const fn from_physx_groups_mask(word2: u32, word3: u32, is_dynamic: bool) -> Filter {
    filter_of_32(word2, word3).with_either(true).with_static(!is_dynamic)
}

/// The filter of a PhysX shape under the shader that most hosts write: `word0` says what it is, `word1` what it
/// meets, and both have to agree.
pub const fn from_physx_words(word0: u32, word1: u32, is_dynamic: bool) -> Filter {
    filter_of_32(word0, word1).with_static(!is_dynamic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    /// Two words and a flag, which many engines have.
    type Field = (u32, u32, bool);

    fn field(random: &mut Random) -> Field {
        (random.word(), random.word(), random.flag())
    }

    fn both_agree(a: &Field, b: &Field) -> bool {
        a.0 & b.1 != 0 && b.0 & a.1 != 0
    }

    #[test]
    fn layers_meet_where_both_agree_as_in_avian_jolt_and_physx() {
        let meet = |a: &Field, b: &Field| !(a.2 && b.2) && both_agree(a, b);
        check(field, |&(of, with, is_static)| from_avian(of, with, is_static), meet);
        let meet = |a: &Field, b: &Field| (a.2 || b.2) && both_agree(a, b);
        check(field, |&(group, mask, is_dynamic)| from_jolt_mask(group, mask, is_dynamic), meet);
        check(field, |&(word0, word1, dynamic)| from_physx_words(word0, word1, dynamic), meet);
    }

    #[test]
    fn rapier_groups_meet_as_in_rapier() {
        let field = |random: &mut Random| (field(random), random.flag());
        let meet = |(a, a_or): &(Field, bool), (b, b_or): &(Field, bool)| {
            let either = a.0 & b.1 != 0 || b.0 & a.1 != 0;
            let groups = if *a_or && *b_or { either } else { both_agree(a, b) };
            groups && (a.2 || b.2)
        };
        check(field, |&((of, with, dynamic), is_or)| from_rapier(of, with, is_or, dynamic), meet);
    }

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

    #[test]
    fn bullet_groups_meet_as_in_bullet() {
        let field = |random: &mut Random| (random.int(), random.int());
        let meet = |a: &(i32, i32), b: &(i32, i32)| a.0 & b.1 != 0 && b.0 & a.1 != 0;
        check(field, |&(group, mask)| from_bullet(group, mask), meet);
        // A static object of 16 bits: the world gives StaticFilter (2) the mask AllFilter ^ StaticFilter.
        let ground = from_bullet(2, i32::from(-1i16 ^ 2));
        let ball = from_bullet(1, i32::from(-1i16));
        assert!(ground.admits(&ball) && ball.admits(&ball));
        assert!(!ground.admits(&ground));
    }

    #[test]
    fn physx_groups_meet_as_the_table_says() {
        let mut random = Random(3 << 40);
        let mut table = [[true; 32]; 32];
        for _ in 0..300 {
            let [a, b] = [random.next(), random.next()].map(|word| (word % 32) as usize);
            let on = random.flag();
            table[a][b] = on;
            table[b][a] = on;
        }
        let row =
            |group: u32| (0..32).fold(0, |row, b| row | u32::from(table[group as usize][b]) << b);
        let field = |random: &mut Random| {
            (random.next() as u32 % 32, random.flag() && random.flag(), random.flag())
        };
        let meet = |a: &(u32, bool, bool), b: &(u32, bool, bool)| match (a.1, b.1) {
            (true, true) => false,
            (false, false) => (a.2 || b.2) && table[a.0 as usize][b.0 as usize],
            _ => true,
        };
        check(
            field,
            |&(group, is_trigger, is_dynamic)| {
                from_physx_group(group, row(group), is_trigger, is_dynamic).expect("below 32")
            },
            meet,
        );
        assert_eq!(from_physx_group(32, 0, false, true), None);
    }

    #[test]
    fn physx_groups_masks_meet_as_swap_and_says() {
        let halves = |word: u32| [word as u16, (word >> 16) as u16];
        let meet = |a: &Field, b: &Field| {
            let ([a0, a1], [a2, a3]) = (halves(a.0), halves(a.1));
            let ([b0, b1], [b2, b3]) = (halves(b.0), halves(b.1));
            let results = [a0 & b2, a1 & b3, a2 & b0, a3 & b1];
            (a.2 || b.2) && results.iter().any(|bits| *bits != 0)
        };
        check(
            field,
            |&(word2, word3, dynamic)| from_physx_groups_mask(word2, word3, dynamic),
            meet,
        );
    }
}
