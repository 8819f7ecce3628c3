//! Local boxes and transforms → world boxes: the first stage of a broad phase.
//!
//! Avril, Gouranton and Arnaldi 2009 (§3) and 2014 give each of c threads n/c objects to update;
//! [`par_write_boxes`](crate::write::par_write_boxes) does so with [`Transformed`] ones, and writes straight
//! into the slice of a frame, so that boxes are never copied. The box of a transformed box is Arvo's (Graphics Gems, 1990): for each entry of the
//! matrix, take the smaller product for the min and the larger one for the max. That is the method
//! of centre and half extents with an absolute matrix, and it also holds for infinite boxes, which
//! have no centre.
//!
//! # No pair is lost to rounding
//!
//! The world box contains the eight corners as exact arithmetic would transform them:
//!
//! * A product of two f32 has 48 significant bits and is exact in f64. A face is the sum of four
//!   such terms tᵢ; three additions err by at most 3.01·u·Σ|tᵢ| with u = 2⁻⁵³.
//! * For a [`Placement`] the entries of the matrix are themselves rounded. Each is a sum of at most
//!   three products of components of the quaternion, which err by at most 8·u·m in all, m being
//!   1 + 2·(the sum of the squared components), and a product with a scale adds u. Its terms then
//!   err by 9·u·m·|scale·coordinate|, and by one more u in the product.
//! * Both are covered: a face moves outward by 8·u·Σ|tᵢ| and, for a placement, by 16·u·m·|scale·coordinate|
//!   for each column. That leaves room for the rounding of the bound itself.
//! * The conversion to f32 rounds outward.
//!
//! The proof is about rounding to nearest and about subnormals as they are, so all of it is computed
//! with the default floating-point flags ([`crate::floats`]), regardless of those of the caller's thread and
//! of its rayon pool. Threads of different flags that update one frame write the same boxes.
//!
//! In all, a face moves by less than two units in the last place of f32 unless the terms cancel to a
//! millionth of their size, and never inward.

use crate::aabb::{Aabb, BoxClass};
use crate::floats;
use crate::isa::AvailableIsa;
use crate::simd::per_isa;
use crate::write::BoxSource;

/// 8u: the distance by which a face moves outward, as a share of the sum of its terms' magnitudes.
const FACE_ERROR: f64 = 8.0 * UNIT_ROUNDOFF;

/// Lanes of a row of numbers: three axes and one of zeroes, which makes them a SIMD register.
const LANES: usize = 4;

/// Half a unit in the last place of 1.0 in f64.
const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// Translation, rotation and scale of an object: a point p goes to `rotation · (scale · p) +
/// translation`.
///
/// The rotation is a quaternion and is not normalised: one that is not of unit length scales points
/// as its matrix does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Where the object's origin lies.
    pub translation: [f32; 3],
    /// Rotation, a quaternion `x y z w`, w the real part.
    pub rotation: [f32; 4],
    /// Scale on the object's own axes.
    pub scale: [f32; 3],
}

impl Placement {
    /// No scale, rotation or translation.
    pub const IDENTITY: Self =
        Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0], scale: [1.0; 3] };

    /// A placement without scale.
    #[inline]
    pub fn rigid(translation: impl Into<[f32; 3]>, rotation: impl Into<[f32; 4]>) -> Self {
        Self { translation: translation.into(), rotation: rotation.into(), ..Self::IDENTITY }
    }
}

/// The affine map of a transform, with bounds of its entries' errors.
#[derive(Clone, Copy, Debug)]
pub struct WorldMatrix {
    /// Columns of the linear part.
    columns: [[f64; LANES]; 3],
    /// Image of the origin.
    translation: [f64; LANES],
    /// Largest error of an entry of each column.
    column_error: [f64; 3],
}

impl WorldMatrix {
    /// A matrix with exact entries.
    #[inline]
    fn exact([x, y, z, translation]: [[f32; 3]; 4]) -> Self {
        Self {
            columns: [x, y, z].map(lanes),
            translation: lanes(translation),
            column_error: [0.0; 3],
        }
    }

    fn is_finite(&self) -> bool {
        let entries = self.columns.iter().flatten().chain(&self.translation);
        // A finite number times zero is zero; an infinity or a NaN makes the sum NaN.
        entries.map(|x| x * 0.0).sum::<f64>() == 0.0
    }
}

/// Three axes in f64, and a zero.
#[inline]
fn lanes([x, y, z]: [f32; 3]) -> [f64; LANES] {
    [x, y, z, 0.0].map(f64::from)
}

/// A map from an object's space to the world's: a [`Placement`], a matrix as arrays, and with the
/// features `glam` and `mint` the matrices of those crates.
pub trait ToWorld {
    /// The map, independent of the floating-point flags of this thread.
    fn world_matrix(&self) -> WorldMatrix;

    /// The same on a thread with the default flags, so that a loop does not read the flags for each
    /// object.
    #[doc(hidden)]
    #[inline]
    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        self.world_matrix()
    }
}

/// Implements [`ToWorld::world_matrix`] for types that compute it with the default flags.
macro_rules! world_matrix_with_any_flags {
    () => {
        #[inline]
        fn world_matrix(&self) -> $crate::update::WorldMatrix {
            let matrix = || $crate::update::ToWorld::world_matrix_with_default_flags(self);
            $crate::floats::with_default(matrix)
        }
    };
}
#[cfg(any(feature = "glam", feature = "mint"))]
pub(crate) use world_matrix_with_any_flags;

/// A 3×4 matrix by columns: the images of the three axes, then that of the origin.
impl ToWorld for [[f32; 3]; 4] {
    world_matrix_with_any_flags!();

    #[inline]
    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        WorldMatrix::exact(*self)
    }
}

/// A 4×4 matrix by columns. The affine part: the bottom row is taken for 0 0 0 1.
impl ToWorld for [[f32; 4]; 4] {
    world_matrix_with_any_flags!();

    #[inline]
    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        WorldMatrix::exact(self.map(|[x, y, z, _]| [x, y, z]))
    }
}

impl ToWorld for Placement {
    world_matrix_with_any_flags!();

    #[inline]
    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        let [x, y, z, w] = self.rotation.map(f64::from);
        let scale = self.scale.map(f64::from);
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y), 0.0],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x), 0.0],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y), 0.0],
        ];
        let magnitude = 1.0 + 2.0 * (x * x + y * y + z * z + w * w);
        WorldMatrix {
            columns: std::array::from_fn(|j| rotation[j].map(|r| r * scale[j])),
            translation: lanes(self.translation),
            column_error: scale.map(|s| 16.0 * UNIT_ROUNDOFF * magnitude * s.abs()),
        }
    }
}

/// The world box of one object.
///
/// An empty box stays empty. A box with a NaN, or a transform with a NaN or an infinity, gives an
/// invalid box, which a cull then counts and names.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::update::world_box;
///
/// let local = Aabb::new([-1.0; 3], [1.0; 3]);
/// let (sin, cos) = std::f32::consts::FRAC_PI_4.sin_cos();
/// let turned = [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
/// let world = world_box(&local, &turned);
/// assert!((world.max[0] - 2.0f32.sqrt()).abs() < 1e-6);
/// ```
#[inline(always)]
pub fn world_box<T: ToWorld>(local: &Aabb, transform: &T) -> Aabb {
    floats::with_default(|| world_box_with_default_flags(local, transform))
}

#[inline(always)]
fn world_box_with_default_flags<T: ToWorld>(local: &Aabb, transform: &T) -> Aabb {
    debug_assert!(floats::are_default(), "boxes are updated with the default flags");
    let matrix = transform.world_matrix_with_default_flags();
    match local.class() {
        BoxClass::Valid if matrix.is_finite() => valid_world_box(local, &matrix),
        BoxClass::Empty => Aabb::EMPTY,
        BoxClass::Valid | BoxClass::Invalid => Aabb { min: [f32::NAN; 3], max: [f32::NAN; 3] },
    }
}

#[inline(always)]
fn valid_world_box(local: &Aabb, matrix: &WorldMatrix) -> Aabb {
    if local.min.iter().chain(&local.max).all(|x| x.is_finite()) {
        box_of_products(local, matrix, |entry, coordinate| entry * coordinate)
    } else {
        box_of_products(local, matrix, product_or_zero)
    }
}

/// A product in which zero times infinity is zero: an axis with a zero entry adds nothing, however
/// far the box extends along it.
fn product_or_zero(entry: f64, coordinate: f64) -> f64 {
    if entry == 0.0 { 0.0 } else { entry * coordinate }
}

#[inline(always)]
fn box_of_products(local: &Aabb, matrix: &WorldMatrix, product: impl Fn(f64, f64) -> f64) -> Aabb {
    let (mut low, mut high) = (matrix.translation, matrix.translation);
    let (mut low_size, mut high_size) = (low.map(f64::abs), high.map(f64::abs));
    let mut slack = 0.0;
    for (j, column) in matrix.columns.iter().enumerate() {
        let (min, max) = (f64::from(local.min[j]), f64::from(local.max[j]));
        for i in 0..LANES {
            // No product is a NaN. A comparison becomes one instruction, where `f64::min` needs
            // more to look for NaN.
            let (a, b) = (product(column[i], min), product(column[i], max));
            let (smaller, larger) = (if a < b { a } else { b }, if a > b { a } else { b });
            low[i] += smaller;
            high[i] += larger;
            low_size[i] += smaller.abs();
            high_size[i] += larger.abs();
        }
        slack += product(matrix.column_error[j], min.abs().max(max.abs()));
    }
    let min: [f32; LANES] =
        std::array::from_fn(|i| round_down(low[i] - (FACE_ERROR * low_size[i] + slack)));
    let max: [f32; LANES] =
        std::array::from_fn(|i| round_up(high[i] + (FACE_ERROR * high_size[i] + slack)));
    let ([x, y, z, _], [u, v, w, _]) = (min, max);
    Aabb { min: [x, y, z], max: [u, v, w] }
}

/// The largest f32 that is not above `x`. Infinity less infinity, an unknown face, counts as the
/// farthest.
#[inline(always)]
fn round_down(x: f64) -> f32 {
    let near = x as f32;
    // The neighbour below by integer arithmetic: `next_down` would branch on a condition that no
    // predictor can guess. The conversion keeps the sign, so that "above" never means +0.0.
    let flip = |bits: i32| bits ^ (((bits >> 31) as u32) >> 1) as i32;
    let above = i32::from(f64::from(near) > x);
    let down = f32::from_bits(flip(flip(near.to_bits() as i32) - above) as u32);
    if x.is_nan() { f32::NEG_INFINITY } else { down }
}

/// The smallest f32 that is not below `x`.
#[inline(always)]
fn round_up(x: f64) -> f32 {
    -round_down(-x)
}

/// Local boxes and as many transforms: a source of world boxes for frames, and for
/// [`write_boxes`](crate::write::write_boxes) and [`par_write_boxes`](crate::write::par_write_boxes).
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::update::{Placement, Transformed};
/// use pairmask_core::write::write_boxes;
///
/// let locals = [Aabb::new([0.0; 3], [1.0; 3]); 2];
/// let at = |x| Placement { translation: [x, 0.0, 0.0], ..Placement::IDENTITY };
/// let mut world = [Aabb::EMPTY; 2];
/// write_boxes(&Transformed::new(&locals, &[at(0.0), at(0.5)]), &mut world);
/// assert!(world[0].overlaps(&world[1]));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Transformed<'a, T> {
    locals: &'a [Aabb],
    transforms: &'a [T],
}

impl<'a, T: ToWorld> Transformed<'a, T> {
    /// The world box of every object.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn new(locals: &'a [Aabb], transforms: &'a [T]) -> Self {
        assert_eq!(locals.len(), transforms.len(), "as many transforms as local boxes");
        Self { locals, transforms }
    }
}

impl<T: ToWorld> BoxSource for Transformed<'_, T> {
    /// A box takes more than ten times as long as one that is copied: as long a task as theirs.
    const TASK_BOXES: usize = 1024;

    fn len(&self) -> usize {
        self.locals.len()
    }

    fn write_range(&self, first: usize, out: &mut [Aabb]) {
        let (locals, transforms) =
            (&self.locals[first..][..out.len()], &self.transforms[first..][..out.len()]);
        floats::with_default(|| update_run(locals, transforms, out, AvailableIsa::best()));
    }
}

per_isa! {
    /// The loop. The boxes are the same: no instruction set fuses or reorders these operations.
    fn update_run<simd: S, T: ToWorld>(locals: &[Aabb], transforms: &[T], out: &mut [Aabb]) {
        let _ = simd;
        for ((local, transform), out) in locals.iter().zip(transforms).zip(out) {
            *out = world_box_with_default_flags(local, transform);
        }
    }
}

#[cfg(test)]
mod tests;
