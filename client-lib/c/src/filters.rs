//! Collision filters: `pm_rules`, filters of other engines; and boxes of other programs.
#![allow(unsafe_code)]

use std::sync::Arc;

use bytemuck::{cast, cast_slice};
use pairmask::Aabb;
use pairmask::filters::{Filter, FilterTable, Rules, engines};

use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{In, Out};
use crate::values::{pm_box, pm_filter, pm_filter_data, pm_pair};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_rules {
    pub id: u64,
}

#[derive(Clone, Copy, Default)]
#[repr(C)]
pub struct pm_rules_desc {
    pub struct_size: usize,
    pub filter_data: In<pm_filter_data>,
    pub filter_data_count: usize,
    pub filters: In<pm_filter>,
    pub filter_count: usize,
    pub included: In<pm_pair>,
    pub included_count: usize,
    pub excluded: In<pm_pair>,
    pub excluded_count: usize,
}

growing!(pm_rules_desc);

#[unsafe(no_mangle)]
pub extern "C" fn pm_rules_create(desc: In<pm_rules_desc>, rules: Out<pm_rules>) -> pm_code {
    rules.give(|| {
        let desc = desc.growing()?;
        let mut made = Rules::default();
        made.filter_data = cast_slice(desc.filter_data.array(desc.filter_data_count)?).to_vec();
        made.table = table(desc.filters, desc.filter_count)?;
        for pair in desc.included.array(desc.included_count)? {
            made.lists.include(cast(*pair), true);
        }
        for pair in desc.excluded.array(desc.excluded_count)? {
            made.lists.exclude(cast(*pair), true);
        }
        pm_rules::new(Arc::new(made))
    })
}

/// A table of a program's filters.
pub fn table(filters: In<pm_filter>, count: usize) -> Result<FilterTable, Failure> {
    let filters: Vec<Filter> = filters.array(count)?.iter().map(|f| Filter::from(*f)).collect();
    Ok(FilterTable::new(&filters)?)
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_rules_drop(rules: pm_rules) -> pm_code {
    rules.drop()
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
