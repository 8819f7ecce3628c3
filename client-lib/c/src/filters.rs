//! Boxes and filters from what other programs have.
#![allow(unsafe_code)]

use pairmask::Aabb;
use pairmask::filters::engines;

use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::memory::{array, value, write};
use crate::values::{pm_box, pm_filter};

fn to_box(b: Aabb) -> pm_box {
    pm_box { min: b.min, max: b.max }
}

fn of_box(b: pm_box) -> Aabb {
    Aabb { min: b.min, max: b.max }
}

/// # Safety
/// As [`array`], for three numbers.
unsafe fn point(numbers: *const f64) -> Result<[f64; 3], Failure> {
    // SAFETY: the caller's promise about pointers is passed on.
    let numbers = unsafe { array(numbers, 3) }?;
    Ok([numbers[0], numbers[1], numbers[2]])
}

/// The f32 box around a box in f64, three numbers a corner, relative to `origin`, rounded outward: no pair is lost
/// where all boxes of a frame have one origin.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_box_outward(
    min: *const f64,
    max: *const f64,
    origin: *const f64,
    b: *mut pm_box,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            let (min, max, origin) = (point(min)?, point(max)?, point(origin)?);
            write(b, to_box(Aabb::outward_from_f64(min, max, origin)))
        }
    })
}

/// What a box touches on its way from one place to another.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_box_swept(
    from: *const pm_box,
    to: *const pm_box,
    b: *mut pm_box,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            let (from, to) = (of_box(value(from)?), of_box(value(to)?));
            write(b, to_box(Aabb::swept(&from, &to)))
        }
    })
}

/// A filter that meets everything.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_all() -> pm_filter {
    pairmask::filters::Filter::ALL.into()
}

/// Rapier's `collision_groups`: memberships, filter, and whether the test mode is Or. `is_dynamic` is false for
/// fixed and kinematic bodies.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_rapier(
    memberships: u32,
    filter: u32,
    is_or: bool,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_rapier(memberships, filter, is_or, is_dynamic).into()
}

/// Box2D's and Box3D's `b2Filter`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_box2d(
    category: u64,
    mask: u64,
    group: i32,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_box2d(category, mask, group, is_dynamic).into()
}

/// Bullet's `m_collisionFilterGroup` and `m_collisionFilterMask`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_bullet(group: i32, mask: i32) -> pm_filter {
    engines::from_bullet(group, mask).into()
}

/// Jolt's `ObjectLayerPairFilterMask`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_jolt_mask(group: u32, mask: u32, is_dynamic: bool) -> pm_filter {
    engines::from_jolt_mask(group, mask, is_dynamic).into()
}

/// The words of a `PxFilterData` for the shader of PhysX's snippets: `word0` is what a shape is, `word1` what it
/// meets.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_physx_words(
    word0: u32,
    word1: u32,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_physx_words(word0, word1, is_dynamic).into()
}

/// Newton's `shape_collision_group`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_newton(group: i32, collides: bool) -> pm_filter {
    engines::from_newton(group, collides).into()
}

/// MuJoCo's `contype` and `conaffinity`.
#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_mujoco(contype: i32, conaffinity: i32) -> pm_filter {
    engines::from_mujoco(contype, conaffinity).into()
}
