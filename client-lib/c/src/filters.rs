//! Boxes and filters from what other programs have.
#![allow(unsafe_code)]

use bytemuck::cast;
use pairmask::Aabb;
use pairmask::filters::engines;

use crate::code::pm_code;
use crate::memory::{In, Out};
use crate::values::{pm_box, pm_filter};

#[unsafe(no_mangle)]
pub extern "C" fn pm_box_outward(
    min: In<f64>,
    max: In<f64>,
    origin: In<f64>,
    b: Out<pm_box>,
) -> pm_code {
    let point = |numbers: In<f64>| numbers.array(3).map(|of| [of[0], of[1], of[2]]);
    b.give(|| Ok(cast(Aabb::outward_from_f64(point(min)?, point(max)?, point(origin)?))))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_box_swept(from: pm_box, to: pm_box) -> pm_box {
    cast(Aabb::swept(&cast(from), &cast(to)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_rapier(
    memberships: u32,
    filter: u32,
    is_or: bool,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_rapier(memberships, filter, is_or, is_dynamic).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_box2d(
    category: u64,
    mask: u64,
    group: i32,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_box2d(category, mask, group, is_dynamic).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_bullet(group: i32, mask: i32) -> pm_filter {
    engines::from_bullet(group, mask).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_jolt_mask(group: u32, mask: u32, is_dynamic: bool) -> pm_filter {
    engines::from_jolt_mask(group, mask, is_dynamic).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_physx_words(
    word0: u32,
    word1: u32,
    is_dynamic: bool,
) -> pm_filter {
    engines::from_physx_words(word0, word1, is_dynamic).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_newton(group: i32, collides: bool) -> pm_filter {
    engines::from_newton(group, collides).into()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_filter_from_mujoco(contype: i32, conaffinity: i32) -> pm_filter {
    engines::from_mujoco(contype, conaffinity).into()
}
