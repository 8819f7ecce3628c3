//! The filters of other engines, as the library writes them.

// The names of engines are words.
#![allow(clippy::doc_markdown)]

use pairmask::filters::engines;
use pyo3::prelude::*;

use crate::rules::PyFilter;

/// The filter of a Rapier collider's `collision_groups`.
#[pyfunction]
#[pyo3(signature = (memberships, filter, *, is_or=false, is_dynamic=true))]
pub fn from_rapier(memberships: u32, filter: u32, is_or: bool, is_dynamic: bool) -> PyFilter {
    PyFilter { filter: engines::from_rapier(memberships, filter, is_or, is_dynamic) }
}

/// The filter of an avian collider's `CollisionLayers`.
#[pyfunction]
#[pyo3(signature = (memberships, filters, *, is_static=false))]
pub fn from_avian(memberships: u32, filters: u32, is_static: bool) -> PyFilter {
    PyFilter { filter: engines::from_avian(memberships, filters, is_static) }
}

/// The filter of a Box2D shape's `b2Filter`.
#[pyfunction]
#[pyo3(signature = (category, mask, group=0, *, is_dynamic=true))]
pub fn from_box2d(category: u64, mask: u64, group: i32, is_dynamic: bool) -> PyFilter {
    PyFilter { filter: engines::from_box2d(category, mask, group, is_dynamic) }
}

/// The filter of a Bullet proxy.
#[pyfunction]
pub fn from_bullet(group: i32, mask: i32) -> PyFilter {
    PyFilter { filter: engines::from_bullet(group, mask) }
}

/// The filter of a MuJoCo geom: `contype`, `conaffinity`.
#[pyfunction]
pub fn from_mujoco(contype: i32, conaffinity: i32) -> PyFilter {
    PyFilter { filter: engines::from_mujoco(contype, conaffinity) }
}

/// The filter of a Newton shape's `shape_collision_group`.
#[pyfunction]
#[pyo3(signature = (group, *, collides=true))]
pub fn from_newton(group: i32, collides: bool) -> PyFilter {
    PyFilter { filter: engines::from_newton(group, collides) }
}

/// The filter of a Jolt body whose object layer holds group and mask bits.
#[pyfunction]
#[pyo3(signature = (group, mask, *, is_dynamic=true))]
pub fn from_jolt_mask(group: u32, mask: u32, is_dynamic: bool) -> PyFilter {
    PyFilter { filter: engines::from_jolt_mask(group, mask, is_dynamic) }
}

/// The filter of a PhysX shape under the shader that most hosts write: `word0` and `word1` of `PxFilterData`.
#[pyfunction]
#[pyo3(signature = (word0, word1, *, is_dynamic=true))]
pub fn from_physx_words(word0: u32, word1: u32, is_dynamic: bool) -> PyFilter {
    PyFilter { filter: engines::from_physx_words(word0, word1, is_dynamic) }
}

/// The owner that stands for an engine's body of this index: shapes of one body never meet.
#[pyfunction]
pub fn owner_of(index: u32) -> u32 {
    engines::owner_of(index).0
}
