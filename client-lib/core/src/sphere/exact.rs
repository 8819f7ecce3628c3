//! The decision d² ≤ (r₁ + r₂)², exact for all finite f32.
//!
//! Three ways, each for what the one before cannot decide.
//!
//! # 1. A filter in f64
//!
//! Centres and radii are f32, so f64 holds them exactly, and none is subnormal there. Let u be the
//! largest relative error of one f64 operation: 2^−53 when rounding to nearest, 2^−52 in any other
//! rounding mode. A difference of two f32 is 0 or at least 2^−149, a square of one then at least
//! 2^−298, and no sum exceeds 3·2^258: nothing underflows or overflows, so every operation has a
//! relative error of at most u, and all terms are ≥ 0, so relative errors do not grow by
//! cancellation. (A fused multiply-add rounds less often; the bounds hold a fortiori.)
//!
//! * D, the computed d²: a difference (squared, so twice u), a product and two sums give
//!   d²(1 − u)⁵ ≤ D ≤ d²(1 + u)⁵.
//! * S, the computed (r₁ + r₂)²: s²(1 − u)³ ≤ S ≤ s²(1 + u)³.
//!
//! With L = 1 − 2^−48 = 1 − 16·2^−52 ≤ 1 − 16u:
//!
//! * If D ≤ fl(S·L), then D ≤ S·L(1 + u), so d² ≤ s²·L(1 + u)⁴/(1 − u)⁵ ≤ s²: **overlap**. For
//!   L(1 + u)⁴/(1 − u)⁵ ≤ (1 − 16u)(1 + 10u) < 1.
//! * If fl(D·L) > S, then D·L(1 + u) > S, so d² > s²·(1 − u)³/(L(1 + u)⁶) ≥ s²: **apart**, by the
//!   same count of nine roundings and one more.
//! * In between is a band of relative width 2^−47: near ties. An infinite radius makes S infinite,
//!   which is an overlap by the first rule, since D is finite. A radius that is NaN (a sphere that
//!   overlaps nothing) makes all comparisons false, which is neither overlap nor near tie.
//!
//! # 2. Integers of 128 bits
//!
//! A finite f32 is m·2^(s−149), m an integer below 2^24 and 0 ≤ s ≤ 253. Divided by the least 2^s
//! among the eight numbers, they are integers, below 2^62 if the greatest s is at most 38 more.
//! Then differences and sums are below 2^63, squares below 2^126, and 3·2^126 < 2^128.
//!
//! # 3. Integers of 640 bits
//!
//! In units of 2^−149 all finite f32 are integers below 2^277: see [`super::fixed`].

use super::Sphere;
use super::fixed::{Fixed, Square};
use crate::aabb::BoxClass;
use crate::precision::widen;

/// 1 − 2^−48: see the head of this module.
pub(super) const LESS: f64 = 1.0 - 1.0 / 281_474_976_710_656.0;

/// A sphere in f64, as it is compared. What overlaps nothing has a radius of NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    pub center: [f64; 3],
    pub radius: f64,
}

impl Ball {
    pub const NOTHING: Self = Self { center: [0.0; 3], radius: f64::NAN };

    /// The sphere, exactly; [`Ball::NOTHING`] if it is empty or invalid.
    #[inline]
    pub fn of(sphere: &Sphere) -> Self {
        match sphere.class() {
            BoxClass::Valid => {
                Self { center: sphere.center.map(widen), radius: widen(sphere.radius) }
            }
            _ => Self::NOTHING,
        }
    }

    /// Whether two spheres share a point.
    #[inline]
    pub fn overlaps(&self, other: &Self) -> bool {
        let (distance, reach) = self.squares(other);
        if distance <= reach * LESS {
            return true;
        }
        distance * LESS <= reach && self.touches(other)
    }

    /// d² and (r₁ + r₂)², rounded.
    #[inline]
    fn squares(&self, other: &Self) -> (f64, f64) {
        let [x, y, z] = std::array::from_fn(|axis| self.center[axis] - other.center[axis]);
        let reach = self.radius + other.radius;
        (x * x + y * y + z * z, reach * reach)
    }

    /// The decision of a near tie, in integers.
    #[cold]
    pub fn touches(&self, other: &Self) -> bool {
        let of = |ball: &Self| {
            let [x, y, z] = ball.center;
            [x, y, z, ball.radius].map(Dyadic::of)
        };
        let (a, b) = (of(self), of(other));
        narrow(&a, &b).unwrap_or_else(|| wide(&a, &b))
    }
}

/// A finite f32: ±mantissa · 2^(shift − 149).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Dyadic {
    negative: bool,
    /// Below 2^24.
    mantissa: u32,
    /// 0 to 253.
    shift: u32,
}

impl Dyadic {
    /// Of an f64 that came from a finite f32.
    fn of(x: f64) -> Self {
        let bits = x.to_bits();
        let exponent = (bits >> 52 & 0x7ff) as i32;
        // 24 bits from the top of the significand; those below are zero. Zero itself has none.
        let significand = if exponent == 0 { 0 } else { (1 << 52 | bits & ((1 << 52) - 1)) >> 29 };
        // The lowest of the 24 bits weighs 2^(exponent − 1023 − 23).
        let shift = exponent - 1023 - 23 + 149;
        let (mantissa, shift) = if shift < 0 {
            // A subnormal f32: bits below 2^−149 are zero.
            (significand.checked_shr(shift.unsigned_abs()).unwrap_or(0), 0)
        } else {
            (significand, shift)
        };
        Self { negative: x.is_sign_negative(), mantissa: mantissa as u32, shift: shift as u32 }
    }
}

/// Most that the shifts may differ for the numbers to be integers below 2^62.
const MOST_SHIFT: u32 = 62 - 24;

/// The decision in 128 bits, where the numbers are of like magnitude.
fn narrow(a: &[Dyadic; 4], b: &[Dyadic; 4]) -> Option<bool> {
    let shifts = || a.iter().chain(b).filter(|x| x.mantissa != 0).map(|x| x.shift);
    let (Some(low), Some(high)) = (shifts().min(), shifts().max()) else {
        return Some(true); // two points at the origin
    };
    if high - low > MOST_SHIFT {
        return None;
    }
    let integer = |x: Dyadic| {
        let magnitude = if x.mantissa == 0 { 0 } else { i64::from(x.mantissa) << (x.shift - low) };
        if x.negative { -magnitude } else { magnitude }
    };
    let square = |x: i64| u128::from(x.unsigned_abs()) * u128::from(x.unsigned_abs());
    let distance: u128 = (0..3).map(|axis| square(integer(a[axis]) - integer(b[axis]))).sum();
    Some(distance <= square(integer(a[3]) + integer(b[3])))
}

/// The decision in 640 bits, for any numbers.
fn wide(a: &[Dyadic; 4], b: &[Dyadic; 4]) -> bool {
    let fixed = |x: Dyadic| Fixed::shifted(u64::from(x.mantissa), x.shift);
    let apart = |x: Dyadic, y: Dyadic| {
        let (p, q) = (fixed(x), fixed(y));
        if x.negative == y.negative { p.difference(&q) } else { p.sum(&q) }
    };
    let distance = (0..3)
        .map(|axis| apart(a[axis], b[axis]).square())
        .fold(Square::ZERO, |sum, square| sum.sum(&square));
    // A radius is −0 at the least.
    distance <= fixed(a[3]).sum(&fixed(b[3])).square()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_two_integer_ways_meet_their_limits() {
        let of = |x: f32| Dyadic::of(widen(x));
        assert_eq!(of(1e-45), Dyadic { negative: false, mantissa: 1, shift: 0 });
        assert_eq!(of(f32::MAX), Dyadic { negative: false, mantissa: (1 << 24) - 1, shift: 253 });
        let spread = |x: f32| [of(1.0), of(0.0), of(0.0), of(x)];
        let two = |exponent: i32| f32::from_bits(((exponent + 127) as u32) << 23);
        assert!(narrow(&spread(two(38)), &spread(1.0)).is_some());
        assert!(narrow(&spread(two(39)), &spread(1.0)).is_none());
        assert_eq!(narrow(&[of(0.0); 4], &[of(-0.0); 4]), Some(true));
    }

    /// Spheres that touch exactly, 3, 4 and 5 times a number of 40 bits apart: about as many of their squares
    /// are rounded to one order as to the other.
    #[test]
    fn ties_are_overlaps_however_their_squares_are_rounded() {
        let (mut above, mut below) = (0, 0);
        for i in 0..1000u32 {
            let (large, small) =
                ((1 << 20) + i * 7919 % 1000, (1 + i * 104_729 % 1_000_000) as f32);
            let (large, small) = (large as f32, small / 1_048_576.0 / 1_048_576.0);
            let ball = |x: f32, sign: f32| {
                Ball::of(&Sphere::new([sign * 3.0 * x, sign * 4.0 * x, 0.0], 5.0 * x))
            };
            let (one, other) = (ball(large, 1.0), ball(small, -1.0));
            let (distance, reach) = one.squares(&other);
            above += u32::from(distance > reach);
            below += u32::from(distance < reach);
            assert!(one.overlaps(&other), "{large} and {small} touch");
            let apart = Ball { radius: widen((5.0 * small).next_down()), ..other };
            assert!(!one.overlaps(&apart), "{large} and {small} are an ulp apart");
        }
        assert!(above > 50 && below > 50, "{above} above, {below} below");
    }

    proptest! {
        #[test]
        fn dyadics_are_the_numbers(bits in any::<u32>()) {
            let x = f32::from_bits(bits);
            if x.is_finite() {
                let d = Dyadic::of(widen(x));
                let unit = f64::from_bits(((1023 + d.shift - 149) as u64) << 52);
                let magnitude = f64::from(d.mantissa) * unit;
                prop_assert_eq!(magnitude, f64::from(x).abs());
                prop_assert_eq!(d.negative, x < 0.0);
            }
        }

        /// Where both integer ways can decide, they agree.
        #[test]
        fn narrow_and_wide_agree(
            a in prop::array::uniform4(-2000i32..2000),
            b in prop::array::uniform4(-2000i32..2000),
            scale in -120i32..100,
        ) {
            let scale = f64::from_bits(((scale + 1023) as u64) << 52);
            let of = |x: [i32; 4]| {
                [x[0], x[1], x[2], x[3].abs()].map(|x| Dyadic::of(f64::from(x) * scale))
            };
            let (a, b) = (of(a), of(b));
            prop_assert_eq!(narrow(&a, &b), Some(wide(&a, &b)));
        }
    }
}
