//! avian: `CollisionLayers`, as `interacts_with` of `src/collision/collider/layers.rs` tests them.

use super::filter_of_32;
use crate::filters::Filter;

/// The filter of an avian collider: the bits of its `CollisionLayers`, and whether its body is
/// `RigidBody::Static`.
///
/// Colliders of one body share its [owner](super::owner_of).
pub const fn from_avian(memberships: u32, filters: u32, is_static: bool) -> Filter {
    filter_of_32(memberships, filters).with_static(is_static)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    #[test]
    fn avian_layers_meet_as_in_avian() {
        let field = |random: &mut Random| (random.word(), random.word(), random.flag());
        let meet = |a: &(u32, u32, bool), b: &(u32, u32, bool)| {
            !(a.2 && b.2) && a.0 & b.1 != 0 && b.0 & a.1 != 0
        };
        check(field, |&(of, with, is_static)| from_avian(of, with, is_static), meet);
    }
}
