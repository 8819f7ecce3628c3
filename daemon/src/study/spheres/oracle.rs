//! Exact rational arithmetic, slow and plain: what the client library's decision is held to.
//!
//! Every finite f32 is a whole number of 2^−149, so that a common denominator of 2^298 makes the
//! rational numbers d² and (r₁ + r₂)² whole. It shares no code with `pairmask::sphere` beyond the
//! layout of a sphere.

use num_bigint::{BigInt, BigUint};
use pairmask::sphere::Sphere;

/// Whether two spheres share a point, by the rules of [`pairmask::sphere`].
///
/// ```
/// use pairmask::sphere::Sphere;
/// use pairmaskd::study::spheres::oracle::overlap;
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

/// The pairs of a scene of spheres, sorted.
pub fn pairs(spheres: &[Sphere]) -> Vec<(u32, u32)> {
    let n = spheres.len() as u32;
    let all = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    all.filter(|&(a, b)| overlap(&spheres[a as usize], &spheres[b as usize])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
