//! Bounding spheres: the 16-byte layout, the exact meaning of "overlap", and the engines.
//!
//! Two spheres overlap when d² ≤ (r₁ + r₂)², with d the distance of their centres, in the arithmetic
//! of real numbers: no rounding, no overflow, no underflow. The all-pairs test is that of Suaib
//! et al. 2015 (§III), decided exactly. What a plain f32 test gets wrong is measured by
//! `pairmask-lab spheres --errors`.
//!
//! * spheres are closed, so touching counts; a radius of ±0 is a point;
//! * a radius below 0 (−∞ among them) makes a sphere **empty**: it overlaps nothing;
//! * a NaN anywhere, or an infinite centre, makes it **invalid**: it overlaps nothing, and is counted
//!   and named. (The distance of two infinite centres is no number.) Invalid wins over empty;
//! * an infinite radius is all of space: it overlaps every valid sphere;
//! * subnormals are the numbers they are, regardless of the denormal flags and the rounding mode of the
//!   thread.
//!
//! The parts: `exact.rs` decides a pair ([`Sphere::overlaps`]); [`SphereAllPairs`] tests every
//! pair; [`SphereFilter`] lets a box engine find the candidates and tests those;
//! [`SphereEngines`](crate::dispatch::SphereEngines) chooses between the two. All write the same pair masks as the box engines do.
//!
//! Sessions take spheres in place of boxes: `Session::sphere_frame`.

mod all_pairs;
mod body;
mod bounds;
mod columns;
mod exact;
mod filter;
mod fixed;
mod kernel;

pub use all_pairs::SphereAllPairs;
pub use filter::SphereFilter;

use bytemuck::{Pod, Zeroable};

use self::exact::Ball;
use crate::aabb::{Aabb, BoxClass, INFINITY_BITS};
use crate::floats;

/// A bounding sphere: `x y z radius`, 16 bytes, little-endian.
///
/// ```
/// use pairmask_core::sphere::Sphere;
/// let a = Sphere::new([0.0, 0.0, 0.0], 1.0);
/// let b = Sphere::new([2.0, 3.0, 6.0], 6.0);
/// assert!(a.overlaps(&b), "7 apart, radii 1 and 6: touching counts");
/// assert!(!a.overlaps(&Sphere::new([2.0, 3.0, 6.0], 6.0f32.next_down())));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius; below 0 for a slot that is disabled.
    pub radius: f32,
}

/// Bytes of one sphere.
pub const SPHERE_BYTES: usize = 16;
const _: () = assert!(size_of::<Sphere>() == SPHERE_BYTES && align_of::<Sphere>() == 4);

impl Sphere {
    /// A disabled slot: overlaps nothing, not even itself.
    pub const EMPTY: Self = Self { center: [0.0; 3], radius: -1.0 };

    /// The sphere of a centre and a radius, as they are.
    ///
    /// The centre is an array, or anything that becomes one: a vector of glam in any version, of nalgebra,
    /// of mint. In a `const`, write the two fields.
    #[inline]
    pub fn new(center: impl Into<[f32; 3]>, radius: f32) -> Self {
        Self { center: center.into(), radius }
    }

    /// A sphere in f32 around a sphere in f64: the centre is rounded, and the radius grows by as much at least. What f32
    /// holds is as it was. A centre beyond f32 becomes infinite, and the sphere invalid.
    ///
    /// ```
    /// use pairmask_core::sphere::Sphere;
    /// assert_eq!(Sphere::outward_from_f64([1.0; 3], 2.0), Sphere::new([1.0; 3], 2.0));
    /// assert!(f64::from(Sphere::outward_from_f64([0.1; 3], 2.0).radius) > 2.0);
    /// ```
    pub fn outward_from_f64(center: [f64; 3], radius: f64) -> Self {
        let rounded = center.map(|x| x as f32);
        // Per axis at most half a unit in the last place, which f64 holds exactly.
        let off: f64 =
            center.iter().zip(rounded).map(|(x, near)| (x - f64::from(near)).abs()).sum();
        let enlarged = if off > 0.0 && radius >= 0.0 { (radius + off).next_up() } else { radius };
        let near = enlarged as f32;
        Self {
            center: rounded,
            radius: if f64::from(near) < enlarged { near.next_up() } else { near },
        }
    }

    /// Valid, empty or invalid, by the rules at the head of this module.
    #[inline]
    pub fn class(&self) -> BoxClass {
        let magnitude = |x: f32| x.to_bits() & 0x7fff_ffff;
        let invalid = self.center.iter().any(|x| magnitude(*x) >= INFINITY_BITS)
            || magnitude(self.radius) > INFINITY_BITS;
        // Bits above those of −0, not a comparison, so that a thread that flushes subnormals sees the
        // same. (Of "the magnitude is not 0" compilers make a comparison of floats.)
        let empty = self.radius.to_bits() > 0x8000_0000;
        match (invalid, empty) {
            (true, _) => BoxClass::Invalid,
            (false, true) => BoxClass::Empty,
            (false, false) => BoxClass::Valid,
        }
    }

    /// Whether two spheres share a point: exact.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        Ball::of(self).overlaps(&Ball::of(other))
    }

    /// A box that holds the sphere, each face rounded outward by at most two steps of f32. Boxes of
    /// spheres that overlap always overlap. What is empty or invalid gives such a box. The flags of the
    /// thread have no say.
    #[inline]
    pub fn bounds(&self) -> Aabb {
        floats::with_default(|| bounds::bounds(self))
    }
}

impl From<[f32; 4]> for Sphere {
    fn from([x, y, z, radius]: [f32; 4]) -> Self {
        Self { center: [x, y, z], radius }
    }
}

impl From<Sphere> for [f32; 4] {
    fn from(Sphere { center: [x, y, z], radius }: Sphere) -> Self {
        [x, y, z, radius]
    }
}

/// Centre and radius, as [`Sphere::new`] takes them.
impl<Center: Into<[f32; 3]>> From<(Center, f32)> for Sphere {
    fn from((center, radius): (Center, f32)) -> Self {
        Self::new(center, radius)
    }
}

impl From<Sphere> for ([f32; 3], f32) {
    fn from(sphere: Sphere) -> Self {
        (sphere.center, sphere.radius)
    }
}

#[cfg(test)]
mod tests;
