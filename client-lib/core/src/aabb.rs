//! Axis-aligned boxes: the 24-byte wire layout and the exact meaning of "overlap".
//!
//! The meaning is fixed for every engine, driver and thread count:
//!
//! * boxes are closed, so touching counts;
//! * −0.0 equals +0.0, subnormals keep their values, ±infinity is a valid coordinate;
//! * a box with `min > max` on any axis is [`BoxClass::Empty`] and overlaps nothing;
//! * a box with a NaN is [`BoxClass::Invalid`] and overlaps nothing.
//!
//! All engines compare the integer keys of [`KeyBox`], never floats: a thread that runs with
//! denormals-are-zero set, or a GPU that flushes subnormals, would otherwise answer differently.

use bytemuck::{Pod, Zeroable};

/// An axis-aligned box as it lies in shared memory: `min.x min.y min.z max.x max.y max.z`, 24 bytes.
///
/// ```
/// use pairmask_core::Aabb;
/// let a = Aabb::new([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]);
/// let b = Aabb::from([1.0, 0.0, 0.0, 2.0, 1.0, 1.0]);
/// assert!(a.overlaps(&b), "touching counts");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Aabb {
    /// Smallest coordinate on each axis.
    pub min: [f32; 3],
    /// Largest coordinate on each axis.
    pub max: [f32; 3],
}

/// Bytes of one box on the wire. Clients of every language rely on it.
pub const AABB_BYTES: usize = 24;
const _: () = assert!(size_of::<Aabb>() == AABB_BYTES && align_of::<Aabb>() == 4);

/// The class of a box, which decides whether it can overlap anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxClass {
    /// Has at least one point.
    Solid,
    /// `min > max` on some axis: an unused slot.
    Empty,
    /// Has a NaN. NaN wins over empty.
    Invalid,
}

impl Aabb {
    /// An unused slot: overlaps nothing, not even itself.
    pub const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    /// The box between two corners, as they are (no sorting: `min > max` means empty).
    ///
    /// Corners are arrays, or types that convert into one: vectors of glam in any version, of
    /// nalgebra, of mint. In a `const`, write the two fields.
    #[inline]
    pub fn new(min: impl Into<[f32; 3]>, max: impl Into<[f32; 3]>) -> Self {
        Self { min: min.into(), max: max.into() }
    }

    /// The box around a centre. `half` holds half edge lengths.
    #[inline]
    pub fn from_center_half(center: impl Into<[f32; 3]>, half: impl Into<[f32; 3]>) -> Self {
        let (center, half) = (center.into(), half.into());
        Self {
            min: std::array::from_fn(|axis| center[axis] - half[axis]),
            max: std::array::from_fn(|axis| center[axis] + half[axis]),
        }
    }

    /// Solid, empty or invalid.
    #[inline]
    pub fn class(&self) -> BoxClass {
        KeyBox::classify(self).1
    }

    /// Whether two boxes share a point, by the rules at the head of this module.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        KeyBox::from(self).overlaps(&KeyBox::from(other))
    }
}

impl From<[f32; 6]> for Aabb {
    #[inline]
    fn from(v: [f32; 6]) -> Self {
        Self { min: [v[0], v[1], v[2]], max: [v[3], v[4], v[5]] }
    }
}

impl From<Aabb> for [f32; 6] {
    #[inline]
    fn from(b: Aabb) -> Self {
        [b.min[0], b.min[1], b.min[2], b.max[0], b.max[1], b.max[2]]
    }
}

/// Two corners, as [`Aabb::new`] takes them.
impl<Min: Into<[f32; 3]>, Max: Into<[f32; 3]>> From<(Min, Max)> for Aabb {
    #[inline]
    fn from((min, max): (Min, Max)) -> Self {
        Self::new(min, max)
    }
}

impl From<Aabb> for ([f32; 3], [f32; 3]) {
    #[inline]
    fn from(b: Aabb) -> Self {
        (b.min, b.max)
    }
}

/// Bits of positive infinity; larger magnitudes are NaN.
pub const INFINITY_BITS: u32 = 0x7f80_0000;

/// Maps the bits of an f32 to an i32 that orders as the numbers do, −0 and +0 to the same key.
///
/// The caller has to exclude NaN ([`KeyBox::classify`]). Keys of numbers lie within ±`0x7f80_0000`,
/// so `i32::MIN` and `i32::MAX` are free for boxes that overlap nothing.
#[inline]
pub const fn order_key(bits: u32) -> i32 {
    let bits = if bits == 0x8000_0000 { 0 } else { bits };
    let key = bits as i32;
    // Negative floats grow in magnitude with their bits: flip all but the sign.
    key ^ (((key >> 31) as u32) >> 1) as i32
}

/// A box in order-preserving integer keys: what every engine compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct KeyBox {
    /// Key of the smallest coordinate on each axis.
    pub min: [i32; 3],
    /// Key of the largest coordinate on each axis.
    pub max: [i32; 3],
}

impl KeyBox {
    /// Overlaps nothing: every comparison with it fails.
    pub const NOTHING: Self = Self { min: [i32::MAX; 3], max: [i32::MIN; 3] };

    /// Keys and class of a box; empty and invalid boxes become [`KeyBox::NOTHING`].
    #[inline]
    pub fn classify(b: &Aabb) -> (Self, BoxClass) {
        let mut key = Self { min: [0; 3], max: [0; 3] };
        let (mut nan, mut empty) = (false, false);
        for axis in 0..3 {
            let (lo, hi) = (b.min[axis].to_bits(), b.max[axis].to_bits());
            nan |= (lo & 0x7fff_ffff) > INFINITY_BITS || (hi & 0x7fff_ffff) > INFINITY_BITS;
            key.min[axis] = order_key(lo);
            key.max[axis] = order_key(hi);
            empty |= key.min[axis] > key.max[axis];
        }
        match (nan, empty) {
            (true, _) => (Self::NOTHING, BoxClass::Invalid),
            (false, true) => (Self::NOTHING, BoxClass::Empty),
            (false, false) => (key, BoxClass::Solid),
        }
    }

    /// A box with these keys, which are those of a solid one: the same box, but for +0 in place of −0.
    #[inline]
    pub fn to_box(&self) -> Aabb {
        let coordinate = |key: i32| f32::from_bits(order_key(key as u32) as u32);
        Aabb { min: self.min.map(coordinate), max: self.max.map(coordinate) }
    }

    /// Closed overlap on all three axes.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|x| self.min[x] <= other.max[x] && other.min[x] <= self.max[x])
    }
}

impl From<&Aabb> for KeyBox {
    #[inline]
    fn from(b: &Aabb) -> Self {
        Self::classify(b).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_order_as_numbers_do() {
        let numbers = [
            f32::NEG_INFINITY,
            f32::MIN,
            -1.0,
            -f32::MIN_POSITIVE,
            -1e-45,
            0.0,
            1e-45,
            f32::MIN_POSITIVE,
            1.0,
            f32::MAX,
            f32::INFINITY,
        ];
        for pair in numbers.windows(2) {
            assert!(order_key(pair[0].to_bits()) < order_key(pair[1].to_bits()), "{pair:?}");
        }
        assert_eq!(order_key((-0.0f32).to_bits()), order_key(0.0f32.to_bits()));
        assert!(order_key(f32::INFINITY.to_bits()) < i32::MAX);
        assert!(order_key(f32::NEG_INFINITY.to_bits()) > i32::MIN);
    }

    #[test]
    fn touching_counts_and_one_ulp_apart_does_not() {
        let a = Aabb::new([0.0; 3], [1.0; 3]);
        let touching = Aabb::new([1.0; 3], [2.0; 3]);
        let apart = Aabb::new([1.0f32.next_up(), 0.0, 0.0], [2.0; 3]);
        assert!(a.overlaps(&touching));
        assert!(!a.overlaps(&apart));
    }

    #[test]
    fn corners_go_in_and_come_out_as_arrays_and_tuples() {
        let (min, max) = ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]);
        let b = Aabb { min, max };
        assert_eq!([Aabb::new(min, max), (min, max).into()], [b; 2]);
        assert_eq!(Aabb::from(((1.0, 2.0, 3.0), max)), b);
        assert_eq!(<([f32; 3], [f32; 3])>::from(b), (min, max));
        assert_eq!(Aabb::from(<[f32; 6]>::from(b)), b);
        assert_eq!(Aabb::from_center_half([2.5, 3.5, 4.5], [1.5; 3]), b);
    }

    #[test]
    fn empty_and_invalid_overlap_nothing_and_nan_wins() {
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        assert!(!Aabb::EMPTY.overlaps(&all) && !Aabb::EMPTY.overlaps(&Aabb::EMPTY));
        let mut invalid = Aabb::EMPTY;
        invalid.max[1] = f32::NAN;
        assert_eq!(invalid.class(), BoxClass::Invalid);
        assert!(!invalid.overlaps(&all));
        assert!(all.overlaps(&all));
    }
}
