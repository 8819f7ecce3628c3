//! The filters of other engines, as the library writes them.

// The names of engines are words.
#![allow(clippy::doc_markdown)]

use pairmask::filters::engines;
use pyo3::prelude::*;

use crate::rules::PyFilter;

/// Functions of `pairmask::filters::engines`, with their signatures in Python.
macro_rules! filters_of_engines {
    ($(
        #[doc = $about:literal]
        $name:ident($($argument:ident: $kind:ty),*) as ($($signature:tt)*);
    )*) => {$(
        #[doc = $about]
        #[pyfunction]
        #[pyo3(signature = ($($signature)*))]
        pub fn $name($($argument: $kind),*) -> PyFilter {
            engines::$name($($argument),*).into()
        }
    )*};
}

filters_of_engines! {
    /// The filter of a Rapier collider's `collision_groups`.
    from_rapier(memberships: u32, filter: u32, is_or: bool, is_dynamic: bool)
        as (memberships, filter, *, is_or=false, is_dynamic=true);
    /// The filter of an avian collider's `CollisionLayers`.
    from_avian(memberships: u32, filters: u32, is_static: bool)
        as (memberships, filters, *, is_static=false);
    /// The filter of a Box2D shape's `b2Filter`.
    from_box2d(category: u64, mask: u64, group: i32, is_dynamic: bool)
        as (category, mask, group=0, *, is_dynamic=true);
    /// The filter of a Bullet proxy.
    from_bullet(group: i32, mask: i32) as (group, mask);
    /// The filter of a MuJoCo geom: `contype`, `conaffinity`.
    from_mujoco(contype: i32, conaffinity: i32) as (contype, conaffinity);
    /// The filter of a Newton shape's `shape_collision_group`.
    from_newton(group: i32, collides: bool) as (group, *, collides=true);
    /// The filter of a Jolt body whose object layer holds group and mask bits.
    from_jolt_mask(group: u32, mask: u32, is_dynamic: bool) as (group, mask, *, is_dynamic=true);
    /// The filter of a PhysX shape under the shader that most hosts write: `word0` and `word1` of `PxFilterData`.
    from_physx_words(word0: u32, word1: u32, is_dynamic: bool)
        as (word0, word1, *, is_dynamic=true);
}

/// The owner that stands for an engine's body of this index: shapes of one body never meet.
#[pyfunction]
pub fn owner_of(index: u32) -> u32 {
    engines::owner_of(index).0
}
