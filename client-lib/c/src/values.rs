//! Plain values, as they lie in memory.

use bytemuck::{Pod, Zeroable};
use pairmask::filters::{Filter, Tag, World};
use pairmask::{Aabb, EndReason, Ended, Sphere};

use crate::failure::Failure;

/// A closed box. `min > max` on some axis makes it empty, a NaN invalid; neither overlaps anything.
/// Infinities are coordinates. Touching counts.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_box {
    /// The smallest corner.
    pub min: [f32; 3],
    /// The largest corner.
    pub max: [f32; 3],
}

/// A closed ball. A radius below zero switches it off.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius.
    pub radius: f32,
}

/// Two indices, the smaller one first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct pm_pair {
    /// The smaller index.
    pub a: u32,
    /// The larger index.
    pub b: u32,
}

/// Why a pair ended: one of `PM_ENDED_...`.
pub type pm_end_reason = u32;
/// A box of the pair was removed, also where its index has a new box.
pub const PM_ENDED_REMOVED: pm_end_reason = 0;
/// A box is switched off now, both are static now, or rules keep them apart.
pub const PM_ENDED_FILTERED: pm_end_reason = 1;
/// The boxes overlap no more.
pub const PM_ENDED_SEPARATED: pm_end_reason = 2;

/// A pair that ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct pm_ended {
    /// The smaller index.
    pub a: u32,
    /// The larger index.
    pub b: u32,
    /// Why.
    pub reason: pm_end_reason,
}

/// Indices from `first` to before `first + count`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct pm_range {
    /// The first one.
    pub first: u32,
    /// How many.
    pub count: u32,
}

/// A world that meets all others.
pub const PM_ALL_WORLDS: i32 = -1;

/// What a box is to the rules. Zeros are what a box has that was given none: world 0, no owner, the first
/// filter.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_tag {
    /// Boxes of different worlds never meet; `PM_ALL_WORLDS` meets all.
    pub world: i32,
    /// Boxes of one owner never meet, unless it is 0.
    pub owner: u32,
    /// Place in the table of filters.
    pub filter: u16,
    /// 1 for a box that is static, whatever its filter says; else 0. Of boxes of a scene `pm_scene_make_static` says
    /// it instead.
    pub is_static: u16,
}

/// What boxes of a kind meet. Two static boxes never meet; equal groups other than 0 decide by their sign; else
/// `(a.category & b.mask) != 0 && (b.category & a.mask) != 0`, with `||` where both say `either`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_filter {
    /// What it is: a bit a category.
    pub category: u64,
    /// What it meets: a bit a category.
    pub mask: u64,
    /// Equal groups: positive, they meet; negative, they do not.
    pub group: i32,
    /// 1 for a kind that is static; else 0.
    pub is_static: u16,
    /// 1 where one mask of two is enough; else 0.
    pub either: u16,
}

/// A program's boxes as the library's.
pub fn boxes(boxes: &[pm_box]) -> &[Aabb] {
    bytemuck::cast_slice(boxes)
}

/// A program's spheres as the library's.
pub fn spheres_mut(spheres: &mut [Sphere]) -> &mut [pm_sphere] {
    bytemuck::cast_slice_mut(spheres)
}

/// A program's tags as the library's.
pub fn tags(tags: &[pm_tag]) -> &[Tag] {
    bytemuck::cast_slice(tags)
}

/// A program's pairs as the library's.
pub fn pairs(pairs: &[pm_pair]) -> &[[u32; 2]] {
    bytemuck::cast_slice(pairs)
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

/// A count that an index can name.
pub fn index_count(count: usize) -> Result<u32, Failure> {
    u32::try_from(count).map_err(|_| Failure::argument("a count is beyond 2^32 - 1"))
}

const _: () = assert!(size_of::<pm_box>() == size_of::<Aabb>());
const _: () = assert!(size_of::<pm_sphere>() == size_of::<Sphere>());
const _: () = assert!(size_of::<pm_tag>() == size_of::<Tag>());
const _: () = assert!(size_of::<pm_pair>() == 8);
const _: () = assert!(PM_ALL_WORLDS == World::ALL.0);
