//! Plain values, as they lie in memory.

use std::ffi::c_char;

use bytemuck::{Pod, Zeroable};
use pairmask::cast::{Hit, Ray};
use pairmask::filters::{Filter, FilterData, World};
use pairmask::{Aabb, EndReason, Ended, ServedBy, Sphere};
use pairmask_core::engine::EngineId;

use crate::failure::Failure;

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_box {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_sphere {
    pub center: [f32; 3],
    pub radius: f32,
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_pair {
    pub a: u32,
    pub b: u32,
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_ray {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub most: f32,
    pub half_extents: [f32; 3],
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_hit {
    pub query: u32,
    pub index: u32,
    pub distance: f32,
}

pub const PM_ANY_BOX: u32 = u32::MAX;

pub type pm_hits = u32;
pub const PM_HITS_ALL: pm_hits = 1;
pub const PM_HITS_CLOSEST: pm_hits = 2;
pub const PM_HITS_ANY: pm_hits = 3;

pub type pm_end_reason = u32;
pub const PM_ENDED_REMOVED: pm_end_reason = 0;
pub const PM_ENDED_FILTERED: pm_end_reason = 1;
pub const PM_ENDED_SEPARATED: pm_end_reason = 2;

#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_ended {
    pub a: u32,
    pub b: u32,
    pub reason: pm_end_reason,
}

#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_range {
    pub first: u32,
    pub count: u32,
}

pub const PM_ALL_WORLDS: i32 = -1;

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_filter_data {
    pub world: i32,
    pub owner: u32,
    pub filter: u16,
    pub is_static: u16,
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_filter {
    pub category: u64,
    pub mask: u64,
    pub group: i32,
    pub is_static: u16,
    pub either: u16,
}

pub type pm_name = [c_char; 24];

/// The name of an engine, cut where there is no room for all of it.
#[allow(clippy::cast_possible_wrap)] // A `char` of C may have a sign.
pub fn name_of(engine: EngineId) -> pm_name {
    let mut name = pm_name::default();
    let room = name.len() - 1;
    for (slot, byte) in name[..room].iter_mut().zip(engine.to_string().bytes()) {
        *slot = byte as c_char;
    }
    name
}

pub type pm_served_by = u32;
pub const PM_SERVED_BY_DAEMON: pm_served_by = 1;
pub const PM_SERVED_BY_THIS_PROCESS: pm_served_by = 2;

/// The number of what answered.
pub const fn served_by_number(by: ServedBy) -> pm_served_by {
    match by {
        ServedBy::Daemon => PM_SERVED_BY_DAEMON,
        ServedBy::InProcess => PM_SERVED_BY_THIS_PROCESS,
    }
}

/// The library's pairs as a program's.
pub fn to_pairs(pairs: &[[u32; 2]]) -> &[pm_pair] {
    bytemuck::cast_slice(pairs)
}

/// A pair that ended, as a program sees it.
pub fn to_ended(ended: Ended) -> pm_ended {
    let Ended { pair: [a, b], reason } = ended;
    let reason = match reason {
        EndReason::Removed => PM_ENDED_REMOVED,
        EndReason::Filtered => PM_ENDED_FILTERED,
        // Every other reason is one of a later version: the boxes are no pair any more.
        _ => PM_ENDED_SEPARATED,
    };
    pm_ended { a, b, reason }
}

impl From<pm_filter> for Filter {
    fn from(f: pm_filter) -> Self {
        Self::new(f.category, f.mask)
            .with_group(f.group)
            .with_static(f.is_static != 0)
            .with_either(f.either != 0)
    }
}

impl From<Filter> for pm_filter {
    fn from(f: Filter) -> Self {
        Self {
            category: f.category,
            mask: f.mask,
            group: f.group,
            is_static: u16::from(f.is_static),
            either: u16::from(f.either),
        }
    }
}

/// A setting, of which zero leaves the choice to the library.
pub fn if_any<T: Default + PartialEq>(setting: T) -> Option<T> {
    Some(setting).filter(|setting| *setting != T::default())
}

/// A count that an index can name.
pub fn index_count(count: usize) -> Result<u32, Failure> {
    u32::try_from(count).map_err(|_| Failure::argument("a count is beyond 2^32 - 1"))
}

const _: () = assert!(size_of::<pm_box>() == size_of::<Aabb>());
const _: () = assert!(size_of::<pm_sphere>() == size_of::<Sphere>());
const _: () = assert!(size_of::<pm_filter_data>() == size_of::<FilterData>());
const _: () = assert!(size_of::<pm_ray>() == size_of::<Ray>());
const _: () = assert!(size_of::<pm_hit>() == size_of::<Hit>());
const _: () = assert!(PM_ANY_BOX == Hit::ANY);
const _: () = assert!(size_of::<pm_pair>() == 8);
const _: () = assert!(PM_ALL_WORLDS == World::ALL.0);
