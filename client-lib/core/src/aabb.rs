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

use crate::floats;

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
    Valid,
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

    /// The box that holds one point.
    #[inline]
    pub fn point(at: impl Into<[f32; 3]>) -> Self {
        let at = at.into();
        Self { min: at, max: at }
    }

    /// What a box may touch on its way from one place to another, if it moves in a straight line and each
    /// face with it: the smallest box that holds both. It is exact, so nothing is rounded.
    ///
    /// Where one of them is empty, that is the other; where one of them is invalid, that one, which overlaps
    /// nothing.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// let from = Aabb::new([0.0; 3], [1.0; 3]);
    /// let to = Aabb::new([4.0, -2.0, 0.0], [5.0, -1.0, 1.0]);
    /// let swept = Aabb::swept(&from, &to);
    /// assert_eq!(swept, Aabb::new([0.0, -2.0, 0.0], [5.0, 1.0, 1.0]));
    /// ```
    pub fn swept(from: &Self, to: &Self) -> Self {
        match (from.class(), to.class()) {
            (BoxClass::Invalid, _) | (_, BoxClass::Empty) => *from,
            (_, BoxClass::Invalid) | (BoxClass::Empty, _) => *to,
            (BoxClass::Valid, BoxClass::Valid) => {
                // Keys, since comparisons of floats depend on the thread's flags.
                let key = |x: f32| order_key(x.to_bits());
                let low = |a, b| if key(b) < key(a) { b } else { a };
                let high = |a, b| if key(b) > key(a) { b } else { a };
                Self {
                    min: std::array::from_fn(|axis| low(from.min[axis], to.min[axis])),
                    max: std::array::from_fn(|axis| high(from.max[axis], to.max[axis])),
                }
            }
        }
    }

    /// What the box may touch while it moves by a displacement in a straight line.
    ///
    /// The faces that move are rounded outward to the nearest number, in any rounding mode of the thread:
    /// the box is never smaller than the exact sweep. A box that overlaps nothing stays as it is, and a
    /// displacement with a NaN makes an invalid box.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// let b = Aabb::new([0.0; 3], [1.0; 3]);
    /// assert_eq!(b.swept_by([2.0, -1.0, 0.0]), Aabb::new([0.0, -1.0, 0.0], [3.0, 1.0, 1.0]));
    /// assert_eq!(b.swept_by([1e-30, 0.0, 0.0]).max[0], 1.0f32.next_up());
    /// ```
    #[must_use]
    pub fn swept_by(&self, displacement: impl Into<[f32; 3]>) -> Self {
        let by = displacement.into();
        if self.class() != BoxClass::Valid {
            return *self;
        }
        floats::with_default(|| {
            let mut swept = *self;
            for axis in 0..3 {
                let (min, max) = (&mut swept.min[axis], &mut swept.max[axis]);
                if by[axis] > 0.0 {
                    *max = sum_above(*max, by[axis]);
                } else if by[axis] < 0.0 {
                    *min = -sum_above(-*min, -by[axis]);
                } else if by[axis].is_nan() {
                    *max = f32::NAN;
                }
            }
            swept
        })
    }

    /// The box moved by a vector, each face rounded outward where f32 does not hold the sum, and whether all of it is
    /// exact. What is infinite, or a NaN, stays.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// let b = Aabb::new([0.5; 3], [1.0; 3]);
    /// assert_eq!(b.moved([1_024.0, 0.0, -0.5]), (Aabb::new([1_024.5, 0.5, 0.0], [1_025.0, 1.0, 0.5]), true));
    /// let (moved, is_exact) = b.moved([0.1, 0.0, 0.0]);
    /// assert!(!is_exact && f64::from(moved.max[0]) > 1.1);
    /// ```
    #[must_use]
    pub fn moved(&self, by: impl Into<[f32; 3]>) -> (Self, bool) {
        let by = by.into();
        floats::with_default(|| {
            let (mut moved, mut is_exact) = (*self, true);
            for axis in 0..3 {
                for (face, is_max) in [(&mut moved.min[axis], false), (&mut moved.max[axis], true)]
                {
                    if face.is_finite() {
                        let above = sum_above(*face, by[axis]);
                        let below = -sum_above(-*face, -by[axis]);
                        is_exact &= above == below && above.is_finite();
                        // Of equal ones the first: a sum that is 0 is not -0.
                        *face = if is_max || above == below { above } else { below };
                    }
                }
            }
            (moved, is_exact)
        })
    }

    /// Valid, empty or invalid.
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

/// Whether a box is [valid](BoxClass::Valid). Needs the default floating-point flags:
/// others take small numbers for 0.
#[inline(always)]
pub(crate) fn is_valid(b: &Aabb) -> bool {
    debug_assert!(floats::are_default());
    (0..3).all(|axis| b.min[axis] <= b.max[axis])
}

/// The smallest number that is not below `x + by`, for a finite x. Needs the default flags.
fn sum_above(x: f32, by: f32) -> f32 {
    debug_assert!(floats::are_default());
    if by == f32::INFINITY {
        return by;
    }
    // The sum of two is `sum + rest` exactly: nothing overflows or underflows in f64.
    let (a, b) = (f64::from(x), f64::from(by));
    let (sum, rest) = floats::two_sum(a, b);
    let rounded = sum as f32;
    let is_below = f64::from(rounded) < sum || (f64::from(rounded) == sum && rest > 0.0);
    if is_below { rounded.next_up() } else { rounded }
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

/// The coordinate of a key that is one of a number: the map to keys is its own inverse, but for −0.
#[inline(always)]
pub(crate) const fn coordinate(key: i32) -> f32 {
    f32::from_bits(order_key(key as u32) as u32)
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
            (false, false) => (key, BoxClass::Valid),
        }
    }

    /// A box with these keys, which are those of a valid one: the same box, but for +0 in place of −0.
    #[inline]
    pub fn to_box(&self) -> Aabb {
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
    use proptest::prelude::*;

    /// A finite number as an integer: in units of the smallest subnormal, 277 bits and a sign.
    fn exact(x: f32) -> (bool, [u64; 6]) {
        let (bits, exponent) = (x.to_bits(), x.to_bits() >> 23 & 0xff);
        let fraction = bits & 0x007f_ffff | if exponent == 0 { 0 } else { 1 << 23 };
        let shift = exponent.max(1) - 1;
        let mut words = [0; 6];
        let wide = u128::from(fraction) << (shift % 64);
        words[shift as usize / 64] = wide as u64;
        words[shift as usize / 64 + 1] = (wide >> 64) as u64;
        (bits >> 31 == 1, words)
    }

    fn negated(words: [u64; 6]) -> [u64; 6] {
        let mut carry = true;
        words.map(|word| {
            let (word, over) = (!word).overflowing_add(u64::from(carry));
            carry = over;
            word
        })
    }

    /// The same in two's complement, most significant word first: biased, so that arrays compare as numbers.
    fn complement(numbers: &[f32]) -> [u64; 6] {
        let mut sum = [0u64; 6];
        for x in numbers {
            let (is_negative, words) = exact(*x);
            let words = if is_negative { negated(words) } else { words };
            let mut carry = 0;
            for (to, word) in sum.iter_mut().zip(words) {
                let wide = u128::from(*to) + u128::from(word) + carry;
                (*to, carry) = (wide as u64, wide >> 64);
            }
        }
        sum[5] ^= 1 << 63;
        sum.reverse();
        sum
    }

    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<u32>().prop_map(f32::from_bits),
            (-100i32..100).prop_map(|x| x as f32),
            (0u32..9).prop_map(f32::from_bits),
            (0u32..9).prop_map(|x| -f32::from_bits(x)),
            (0u32..9).prop_map(|x| f32::from_bits(INFINITY_BITS - x)),
        ]
    }

    #[test]
    fn exact_sums_order_as_numbers_do() {
        let rising: [&[f32]; 7] = [
            &[f32::MIN, f32::MIN],
            &[f32::MIN, -1e-45],
            &[-1.0, 1e-45],
            &[1e-45, -1e-45],
            &[1e-45],
            &[1.0, f32::MIN_POSITIVE],
            &[f32::MAX, 1e-45],
        ];
        for pair in rising.windows(2) {
            assert!(complement(pair[0]) < complement(pair[1]), "{pair:?}");
        }
    }

    proptest! {
        #[test]
        fn a_sweep_is_the_smallest_box_that_holds_the_exact_one(
            x in number(), length in number(), by in number(),
        ) {
            prop_assume!(!x.is_nan() && !length.is_nan() && !by.is_nan());
            let (low, high) = if x <= length { (x, length) } else { (length, x) };
            let b = Aabb::new([low; 3], [high; 3]);
            let swept = b.swept_by([by, 0.0, -by]);
            prop_assert_eq!((swept.min[1], swept.max[1]), (low, high));
            for (axis, by) in [(0, by), (2, -by)] {
                let (min, max) = (swept.min[axis], swept.max[axis]);
                prop_assert!(min <= low && max >= high);
                prop_assert!(by > 0.0 || max == high);
                prop_assert!(by < 0.0 || min == low);
                let moved = if by > 0.0 { [high, max] } else { [low, min] };
                if by.is_infinite() {
                    prop_assert!(by == 0.0 || moved[1] == by);
                } else if moved[0].is_infinite() {
                    prop_assert_eq!(moved[1], moved[0]);
                } else if by != 0.0 {
                    let sum = complement(&[moved[0], by]);
                    let not_within = |x: f32, beyond: f32| match x {
                        x if x.is_infinite() => (x > 0.0) != (beyond > 0.0),
                        x if beyond > 0.0 => complement(&[x]) < sum,
                        x => complement(&[x]) > sum,
                    };
                    prop_assert!(!not_within(moved[1], by), "holds the exact sum");
                    let inner = if by > 0.0 { moved[1].next_down() } else { moved[1].next_up() };
                    prop_assert!(not_within(inner, by), "no smaller number does");
                }
            }
        }

        #[test]
        fn a_sweep_between_positions_holds_both_and_no_more(
            from in prop::array::uniform6(number()), to in prop::array::uniform6(number()),
        ) {
            let (from, to) = (Aabb::from(from), Aabb::from(to));
            let swept = Aabb::swept(&from, &to);
            let classes = (from.class(), to.class());
            if classes == (BoxClass::Valid, BoxClass::Valid) {
                for axis in 0..3 {
                    prop_assert_eq!(swept.min[axis], from.min[axis].min(to.min[axis]));
                    prop_assert_eq!(swept.max[axis], from.max[axis].max(to.max[axis]));
                }
            } else if classes.0 == BoxClass::Invalid || classes.1 == BoxClass::Invalid {
                prop_assert_eq!(swept.class(), BoxClass::Invalid);
            } else {
                let other = if classes.0 == BoxClass::Empty { to } else { from };
                prop_assert_eq!(swept.class(), other.class());
                prop_assert!(swept.class() == BoxClass::Empty || swept == other);
            }
        }
    }

    #[test]
    fn sweeps_of_what_overlaps_nothing_overlap_nothing() {
        let valid = Aabb::point([1.0, -0.0, 3.0]);
        assert_eq!(valid.class(), BoxClass::Valid);
        assert!(valid.overlaps(&valid));
        assert_eq!(Aabb::point([0.0, f32::NAN, 0.0]).class(), BoxClass::Invalid);
        assert_eq!(Aabb::EMPTY.swept_by([1.0; 3]), Aabb::EMPTY);
        assert_eq!(valid.swept_by([0.0, f32::NAN, 0.0]).class(), BoxClass::Invalid);
        assert_eq!(Aabb::swept(&valid, &Aabb::EMPTY), valid);
        assert_eq!(Aabb::swept(&Aabb::EMPTY, &valid), valid);
        let far = Aabb::point([f32::NEG_INFINITY; 3]).swept_by([f32::INFINITY, 1.0, -1.0]);
        assert_eq!(far.max, [f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY]);
        assert_eq!(far.class(), BoxClass::Valid);
    }

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
    fn corners_go_in_and_come_out_as_arrays_and_tuples() {
        let (min, max) = ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]);
        let b = Aabb { min, max };
        assert_eq!([Aabb::new(min, max), (min, max).into()], [b; 2]);
        assert_eq!(Aabb::from(((1.0, 2.0, 3.0), max)), b);
        assert_eq!(<([f32; 3], [f32; 3])>::from(b), (min, max));
        assert_eq!(Aabb::from(<[f32; 6]>::from(b)), b);
        assert_eq!(Aabb::from_center_half([2.5, 3.5, 4.5], [1.5; 3]), b);
    }

    proptest! {
        #[test]
        fn valid_boxes_are_those_of_that_class(
            bits in prop::array::uniform6(any::<u32>()),
            special in prop::array::uniform6(0usize..12),
        ) {
            const SPECIAL: [u32; 8] =
                [0, 1 << 31, 1, 0x8000_0001, 0x7f80_0000, 0xff80_0000, 0x7fc0_0000, 0xff80_0001];
            let b = Aabb::from(std::array::from_fn::<f32, 6, _>(|i| {
                f32::from_bits(SPECIAL.get(special[i]).copied().unwrap_or(bits[i]))
            }));
            prop_assert_eq!(is_valid(&b), b.class() == BoxClass::Valid);
        }
    }
}
