//! The box around a sphere, rounded outward.

use super::Sphere;
use crate::aabb::{Aabb, BoxClass};
use crate::precision::widen;

/// A box that holds the sphere. It does with any flags of the thread, and it is the same box where
/// they are the default ones, with which callers call it.
///
/// Why no pair is lost: spheres that overlap have |x₁ − x₂| ≤ d ≤ r₁ + r₂ on every axis, so the
/// intervals [x − r, x + r] of real numbers meet, and so do intervals that hold those.
///
/// Why the rounded intervals hold them: x ± r in f64 is off by at most one step of f64 in any
/// rounding mode (nothing underflows: both are multiples of 2^−149), so one step outward holds the
/// real number; then the bits are cut to f32 on the far side.
pub(super) fn bounds(sphere: &Sphere) -> Aabb {
    match sphere.class() {
        BoxClass::Valid => {}
        BoxClass::Empty => return Aabb::EMPTY,
        BoxClass::Invalid => return Aabb { min: [f32::NAN; 3], max: [f32::NAN; 3] },
    }
    let (center, radius) = (sphere.center.map(widen), widen(sphere.radius));
    Aabb {
        min: center.map(|x| -at_least((radius - x).next_up())),
        max: center.map(|x| at_least((x + radius).next_up())),
    }
}

/// The least f32 that is not below `x`, which is no NaN. By integers: a conversion would make
/// subnormals 0 on a thread that flushes them.
fn at_least(x: f64) -> f32 {
    /// Exponent of f64 that stands for 2^−126, the least normal f32.
    const LEAST_NORMAL: u64 = 1023 - 126;
    let bits = x.to_bits();
    let exponent = bits >> 52 & 0x7ff;
    let significand = bits & ((1 << 52) - 1);
    // The magnitude cut to f32, and whether something was cut off.
    let (cut, rest) = if exponent >= LEAST_NORMAL {
        // Beyond f32 this is at or above the bits of infinity.
        ((exponent - LEAST_NORMAL + 1) << 23 | significand >> 29, significand << 35)
    } else {
        // In units of 2^−149: 29 bits less, and as many as 2^−126 is above the exponent.
        let shift = 29 + (LEAST_NORMAL - exponent);
        let full = if exponent == 0 { significand } else { significand | 1 << 52 };
        if shift >= 64 { (0, full) } else { (full >> shift, full << (64 - shift)) }
    };
    let infinity = u64::from(f32::INFINITY.to_bits());
    if x.is_sign_negative() {
        // Cut towards 0 is up. Beyond f32 that is the largest finite number.
        let magnitude = if cut >= infinity && x != f64::NEG_INFINITY { infinity - 1 } else { cut };
        -f32::from_bits(magnitude.min(infinity) as u32)
    } else {
        f32::from_bits((cut + u64::from(rest != 0)).min(infinity) as u32)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn faces_lie_outside_and_near() {
        let bounds = Sphere::new([0.0, 1.0, -1e30], 1.0).bounds();
        assert!(bounds.min[0] <= -1.0 && bounds.min[0] >= -1.0f32.next_up().next_up());
        assert!(bounds.max[1] >= 2.0 && bounds.max[1] <= 2.0f32.next_up());
        assert!(bounds.min[2] < -1e30 && bounds.min[2] >= (-1e30f32).next_down());
        let all = Sphere::new([3.0; 3], f32::INFINITY).bounds();
        assert_eq!((all.min, all.max), ([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]));
        let largest = Sphere::new([f32::MAX; 3], f32::MAX).bounds();
        assert!(largest.min[0] < 0.0 && largest.max[0] == f32::INFINITY);
        let point = Sphere::new([0.0; 3], 0.0).bounds();
        assert_eq!((point.min, point.max), ([-1e-45; 3], [1e-45; 3]));
        assert_eq!(Sphere::EMPTY.bounds().class(), BoxClass::Empty);
        assert_eq!(Sphere::new([f32::INFINITY; 3], 1.0).bounds().class(), BoxClass::Invalid);
    }

    proptest! {
        #[test]
        fn at_least_is_the_least(bits in any::<u64>()) {
            let x = f64::from_bits(bits);
            if !x.is_nan() {
                let y = at_least(x);
                prop_assert!(f64::from(y) >= x, "{} below {}", y, x);
                prop_assert!(f64::from(y.next_down()) < x || y == f32::NEG_INFINITY, "{} for {}", y, x);
            }
        }

        #[test]
        fn at_least_is_the_least_near_f32(bits in any::<u32>(), step in -3i32..4) {
            let near = f32::from_bits(bits);
            if near.is_finite() {
                let mut x = f64::from(near);
                for _ in 0..step.unsigned_abs() {
                    x = if step < 0 { x.next_down() } else { x.next_up() };
                }
                let y = at_least(x);
                prop_assert!(f64::from(y) >= x && f64::from(y.next_down()) < x, "{} for {}", y, x);
            }
        }
    }
}
