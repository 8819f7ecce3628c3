//! Overlap of spheres in plain exact rational arithmetic, the reference for the client library's
//! decision.
//!
//! Every finite f32 is a whole number of 2^−149, so that a common denominator of 2^298 makes the
//! rational numbers d² and (r₁ + r₂)² whole. This module shares no code with `pairmask_core::sphere`
//! beyond the layout of a sphere.
//!
//! Where the eight numbers of a pair are of like magnitude, a coarser common denominator makes them
//! whole within 64 bits and their squares within 128; that is most pairs. All others take integers of
//! any size; the tests compare both ways.

use num_bigint::{BigInt, BigUint};
use pairmask_core::sphere::Sphere;

/// Whether two spheres share a point, by the rules of [`pairmask_core::sphere`].
///
/// ```
/// use pairmask_core::sphere::Sphere;
/// use pairmaskd::audit::sphere_oracle::overlap;
/// let a = Sphere::new([0.0, 0.0, 0.0], 1.0);
/// assert!(overlap(&a, &Sphere::new([2.0, 3.0, 6.0], 6.0)));
/// assert!(!overlap(&a, &Sphere::new([2.0, 3.0, 6.0], 6.0f32.next_down())));
/// ```
pub fn overlap(a: &Sphere, b: &Sphere) -> bool {
    let solid = |s: &Sphere| s.center.iter().all(|x| x.is_finite()) && s.radius >= 0.0;
    if !solid(a) || !solid(b) {
        return false;
    }
    if a.radius == f32::INFINITY || b.radius == f32::INFINITY {
        return true;
    }
    overlap_of_like(a, b).unwrap_or_else(|| overlap_of_any(a, b))
}

/// Widest range of exponents that [`overlap_of_like`] takes. Whole numbers are then below 2^(24 +
/// 36), differences and sums of two below 2^61, and a sum of three squares below 2^124.
const LIKE_EXPONENTS: u32 = 36;

/// Whether two solid, finite spheres share a point; `None` where their numbers are not of like
/// magnitude.
fn overlap_of_like(a: &Sphere, b: &Sphere) -> Option<bool> {
    let parts = [a, b].map(|s| [s.center[0], s.center[1], s.center[2], s.radius].map(parts));
    let exponents = || parts.iter().flatten().filter(|(m, _)| *m != 0).map(|(_, e)| *e);
    let least = exponents().min().unwrap_or(0);
    if exponents().max().unwrap_or(0) - least > LIKE_EXPONENTS {
        return None;
    }
    // Zero is whole in any unit, and its exponent is 0.
    let whole = |(magnitude, exponent): (i64, u32)| magnitude << exponent.saturating_sub(least);
    let [p, q] = parts.map(|numbers| numbers.map(whole));
    let square = |x: i64| i128::from(x) * i128::from(x);
    let distance: i128 = (0..3).map(|axis| square(p[axis] - q[axis])).sum();
    Some(distance <= square(p[3] + q[3]))
}

/// A finite f32 as m · 2^e in units of 2^−149, |m| below 2^24.
fn parts(x: f32) -> (i64, u32) {
    let bits = x.abs().to_bits();
    let (exponent, fraction) = (bits / (1 << 23), i64::from(bits % (1 << 23)));
    let (magnitude, exponent) =
        if exponent == 0 { (fraction, 0) } else { (fraction + (1 << 23), exponent - 1) };
    (if x < 0.0 { -magnitude } else { magnitude }, exponent)
}

/// Whether two solid, finite spheres share a point, whatever their magnitudes.
fn overlap_of_any(a: &Sphere, b: &Sphere) -> bool {
    let square = |x: BigInt| &x * &x;
    let distance: BigInt =
        (0..3).map(|axis| square(whole(a.center[axis]) - whole(b.center[axis]))).sum();
    distance <= square(whole(a.radius) + whole(b.radius))
}

/// A finite f32 in units of 2^−149.
fn whole(x: f32) -> BigInt {
    let bits = x.abs().to_bits();
    let (exponent, fraction) = (bits / (1 << 23), bits % (1 << 23));
    let magnitude = match exponent {
        0 => BigUint::from(fraction),
        _ => BigUint::from(fraction + (1 << 23)) << (exponent - 1),
    };
    if x < 0.0 { -BigInt::from(magnitude) } else { BigInt::from(magnitude) }
}

#[cfg(test)]
mod tests {
    use pairmask_tests::spheres::hard_pairs;

    use super::*;

    #[test]
    fn both_ways_agree_and_both_are_taken() {
        let (mut like, mut unlike) = (0, 0);
        for (a, b) in hard_pairs(2_000, 11) {
            match overlap_of_like(&a, &b) {
                Some(overlaps) => {
                    like += 1;
                    assert_eq!(overlaps, overlap_of_any(&a, &b), "{a:?} {b:?}");
                }
                None => unlike += 1,
            }
        }
        assert!(like > 4_000 && unlike > 1_000, "{like} of like magnitude, {unlike} others");
    }

    #[test]
    fn the_widest_range_of_magnitudes_does_not_overflow() {
        let (large, small) = (f32::from_bits((37 << 23) | 0x7f_ffff), f32::from_bits(1 << 23));
        let spread = |x: f32, radius: f32| Sphere::new([x; 3], radius);
        for (a, b) in [
            (spread(-large, small), spread(large, small)),
            (spread(-large, large), spread(large, large)),
            (spread(small, large), spread(large, large)),
        ] {
            assert_eq!(overlap_of_like(&a, &b), Some(overlap_of_any(&a, &b)), "{a:?} {b:?}");
        }
        let wider = f32::from_bits((38 << 23) | 1);
        assert_eq!(overlap_of_like(&spread(wider, small), &spread(small, small)), None);
    }

    #[test]
    fn whole_numbers_are_those_of_the_format() {
        assert_eq!(whole(0.0), BigInt::from(0));
        assert_eq!(whole(-1e-45), BigInt::from(-1));
        assert_eq!(whole(f32::MIN_POSITIVE), BigInt::from(1 << 23));
        assert_eq!(whole(1.0), BigInt::from(1) << 149);
        let largest: BigInt = (BigInt::from(1) << 277) - (BigInt::from(1) << 253);
        assert_eq!(whole(-f32::MAX), -largest);
    }
}
