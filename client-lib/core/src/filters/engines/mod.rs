//! The filters of other engines, written as [`Filter`]s, [`Owner`]s and lists.
//!
//! Each function takes an engine's fields as plain integers. What an engine decides from those fields,
//! [`Rules`](super::Rules) decide too.
//!
//! | engine | its fields | what they become | left to the host |
//! |---|---|---|---|
//! | Rapier | `collision_groups`: memberships, filter, test mode | [`from_rapier`] | solver groups, hooks, other `ActiveCollisionTypes` than the default |
//! | avian | `CollisionLayers`: memberships, filters | [`from_avian`] | hooks, sleeping bodies, `JointCollisionDisabled` as excluded pairs |
//! | Box2D, Box3D | `b2Filter`: `categoryBits`, `maskBits`, `groupIndex` | [`from_box2d`] | custom filter callback, sensors, joints as excluded pairs |
//! | Bullet | `collisionFilterGroup`, `collisionFilterMask` | [`from_bullet`] | `btOverlapFilterCallback`, near callback |
//! | Jolt | object layers by table or by mask, collision groups | [`from_jolt_layers`], [`from_jolt_mask`], [`from_jolt_groups`] | contact listeners, shape filters; broad-phase layers only sort the pairs |
//! | PhysX | the words of `PxFilterData`, for three common shaders | [`from_physx_group`], [`from_physx_groups_mask`], [`from_physx_words`] | other shaders, `PxSimulationFilterCallback` |
//! | Newton | `shape_collision_group` | [`from_newton`] | |
//! | MuJoCo | `contype`, `conaffinity`, bodies, `<pair>`, `<exclude>` | [`from_mujoco`], [`from_mujoco_bodies`] | `mjcb_contactfilter`, sleeping bodies |
//!
//! Functions that take `is_dynamic` mark the filter static where it is false: these engines let no two
//! bodies meet of which none is dynamic, triggers of PhysX aside. Where a host needs kinematic bodies to
//! meet others that are not dynamic, it passes true for those.
//!
//! Other fields become parts of a [`FilterData`](super::FilterData) as they are:
//!
//! * **Shapes of one body** never meet in any of these engines but Bullet and Jolt, where a body is one
//!   shape: [`owner_of`] the body. A `PxAggregate` without self collisions is the owner of all shapes of
//!   its actors.
//! * **Worlds**: `shape_world` of Newton is a [`World`](super::World), −1 included.
//! * **Excluded pairs**, such as `shape_collision_filter_pairs` of Newton or bodies that share a joint, go
//!   into [`PairLists`](super::PairLists).

// The names of engines are words.
#![allow(clippy::doc_markdown)]

mod jolt;
mod masks;
mod mujoco;
mod newton;
mod relation;
#[cfg(test)]
mod testing;

pub use self::jolt::{JoltGroup, from_jolt_groups, from_jolt_layers};
pub use self::masks::{
    from_avian, from_box2d, from_bullet, from_jolt_mask, from_physx_group, from_physx_groups_mask,
    from_physx_words, from_rapier,
};
pub use self::mujoco::{MujocoBodies, MujocoError, from_mujoco, from_mujoco_bodies};
pub use self::newton::from_newton;
pub use self::relation::from_relation;

use super::filter::Filter;
use super::filter_data::Owner;

/// The owner that stands for an engine's body, actor or aggregate of this index. `u32::MAX`, which engines
/// use for none, is [`Owner::NONE`].
pub const fn owner_of(index: u32) -> Owner {
    Owner(index.wrapping_add(1))
}

/// The 32 bits of an engine's signed field as bits of a category or mask.
const fn bits(field: i32) -> u64 {
    field.cast_unsigned() as u64
}

/// Bits of an engine that has 32 of them.
const fn filter_of_32(category: u32, mask: u32) -> Filter {
    Filter::new(category as u64, mask as u64)
}
