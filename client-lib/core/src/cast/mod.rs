//! Casts: which boxes a ray hits, and which are nearest to a point, in the order of their distance.
//!
//! # What is hit
//!
//! All of this holds in the arithmetic of real numbers, without rounding:
//!
//! * A [`Ray`] hits a box if a point `origin + t · direction` with 0 ≤ t ≤ `most` lies in the box, whose faces were moved
//!   outward by the ray's `half_extents`. Its distance is the least such t. So a box that contains the origin is at 0.
//! * Boxes are closed, as everywhere (see [`aabb`](crate::aabb)): a ray along a face hits. −0 is 0. A component 0 of the
//!   direction moves nothing; a direction of zeros asks about the origin alone.
//! * A box may reach to infinity, and is hit where a finite t reaches it. A box that lies at infinity is never hit.
//! * A ray is invalid, and hits nothing, if its origin, direction or half extents are NaN or infinite, half extents or
//!   `most` negative, or `most` a NaN. `most` may be infinite.
//! * A [`Sphere`](crate::sphere::Sphere) touches a box if a point of the box is at most its radius away from its center,
//!   and the distance is that of the nearest one. An infinite radius finds all boxes that are not at infinity. Spheres that
//!   are [empty or invalid](crate::sphere) find nothing.
//!
//! Hits come by distance and then by index, also where two distances differ by less than floats can say. A reported
//! distance is rounded to f32: it may be one step of f32 from the nearest one. So the answer depends on boxes and questions
//! alone, on any number of threads, engine or machine.
//!
//! # How
//!
//! Boxes lie in a tree of groups of 16 ([`BoxTree`]), in the order that `cpu-tree` brings them into. A search goes from
//! the whole down, the nearest group first, with bounds in f32 that are rounded outward (Ize 2013), 16 groups or boxes
//! at a time. Several searches take turns: what one asks memory for comes while the others are at work. A box within its
//! bounds is decided in f64, and where that is too close to say, by exact sums (Shewchuk
//! 1997).
//!
//! ```text
//! exact     the sign of a sum of f64
//! node      16 boxes side by side
//! probe     what a ray and a sphere have in common
//! ray, near the two of them
//! tree      boxes in groups, kept right as they move
//! search    the hits of one question
//! batch     those of many
//! overlap   the boxes that a box overlaps
//! ```

mod batch;
mod exact;
mod near;
mod node;
mod overlap;
mod probe;
mod ray;
mod search;
mod tree;

pub use self::batch::{Among, CandidatesOf, Deciders, Limits, Shapes};
pub(crate) use self::overlap::Ahead;
pub use self::tree::{BoxTree, near_order};

use bytemuck::{Pod, Zeroable};

use crate::aabb::{Aabb, is_valid};

/// A ray or a segment, thin or as thick as a box that is swept along it: 40 bytes.
///
/// ```
/// use pairmask_core::cast::Ray;
///
/// let down = Ray::new([0.0, 10.0, 0.0], [0.0, -1.0, 0.0]).up_to(25.0);
/// assert_eq!(down.most, 25.0);
/// let thick = down.with_half_extents([0.5; 3]);
/// assert_eq!(thick.half_extents, [0.5; 3]);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Where it begins.
    pub origin: [f32; 3],
    /// Where it goes in a unit of t. Need not be of length 1.
    pub direction: [f32; 3],
    /// Its end: the largest t. Infinite for a ray without an end.
    pub most: f32,
    /// Half the edges of the box that is swept along it, with the origin in its center; 0 for a thin ray. A swept sphere
    /// is within the box that has its radius on each axis.
    pub half_extents: [f32; 3],
}

/// Bytes of a ray.
pub const RAY_BYTES: usize = 40;
const _: () = assert!(size_of::<Ray>() == RAY_BYTES && align_of::<Ray>() == 4);

impl Ray {
    /// A thin ray without an end.
    pub fn new(origin: impl Into<[f32; 3]>, direction: impl Into<[f32; 3]>) -> Self {
        Self {
            origin: origin.into(),
            direction: direction.into(),
            most: f32::INFINITY,
            half_extents: [0.0; 3],
        }
    }

    /// The segment between two points: t goes from 0 to 1. The direction is rounded to f32.
    pub fn between(from: impl Into<[f32; 3]>, to: impl Into<[f32; 3]>) -> Self {
        let (from, to) = (from.into(), to.into());
        let direction = std::array::from_fn(|axis| to[axis] - from[axis]);
        Self::new(from, direction).up_to(1.0)
    }

    /// The same with an end.
    #[must_use]
    pub const fn up_to(self, most: f32) -> Self {
        Self { most, ..self }
    }

    /// The same as thick as a box with these half edges, or as one around a sphere of a radius.
    #[must_use]
    pub const fn with_half_extents(self, half_extents: [f32; 3]) -> Self {
        Self { half_extents, ..self }
    }
}

/// Which boxes a cast reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hits {
    /// All.
    All,
    /// So many of the closest.
    Closest(u32),
    /// Whether there is one: a single hit with the index [`Hit::ANY`] and the distance 0, or none. A shadow test.
    Any,
}

/// A box that a ray has hit, or that is near a point: 12 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Hit {
    /// The ray or the sphere, counted from 0.
    pub query: u32,
    /// The box.
    pub index: u32,
    /// Along a ray in lengths of its direction; from a sphere's center in units of coordinates.
    pub distance: f32,
}

/// Bytes of a hit.
pub const HIT_BYTES: usize = 12;
const _: () = assert!(size_of::<Hit>() == HIT_BYTES && align_of::<Hit>() == 4);

impl Hit {
    /// The index of a hit that stands for any box.
    pub const ANY: u32 = u32::MAX;
}

/// A box that can be hit, or [`NOTHING`](node::NOTHING) in place of one that overlaps nothing.
fn hittable(b: &Aabb) -> Aabb {
    if is_valid(b) { *b } else { node::NOTHING }
}
