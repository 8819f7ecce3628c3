//! Rapier: `InteractionGroups`, as `src/geometry/interaction_groups.rs` tests them.

use super::filter_of_32;
use crate::filters::Filter;

/// The filter of a Rapier collider: the memberships and the filter of its `collision_groups`.
///
/// `is_or` says whether their test mode is `Or`: it counts where both say so, as in Rapier since 0.27. By
/// default Rapier lets no pair of bodies meet of which none is dynamic (`ActiveCollisionTypes`).
/// Colliders of one body share its [owner](super::owner_of). Solver groups do not matter to a broad phase.
pub const fn from_rapier(memberships: u32, filter: u32, is_or: bool, is_dynamic: bool) -> Filter {
    filter_of_32(memberships, filter).with_either(is_or).with_static(!is_dynamic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    #[test]
    fn rapier_groups_meet_as_in_rapier() {
        let field =
            |random: &mut Random| (random.word(), random.word(), random.flag(), random.flag());
        let meet = |a: &(u32, u32, bool, bool), b: &(u32, u32, bool, bool)| {
            let (in_b, in_a) = (a.0 & b.1 != 0, b.0 & a.1 != 0);
            let groups = match (a.2, b.2) {
                (true, true) => in_b || in_a,
                _ => in_b && in_a,
            };
            groups && (a.3 || b.3)
        };
        check(
            field,
            |&(memberships, filter, is_or, is_dynamic)| {
                from_rapier(memberships, filter, is_or, is_dynamic)
            },
            meet,
        );
    }
}
