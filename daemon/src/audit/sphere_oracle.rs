//! Overlap of spheres in plain exact rational arithmetic, the reference for the client library's
//! decision.
//!
//! Every finite f32 is a whole number of 2^−149, so that a common denominator of 2^298 makes the
//! rational numbers d² and (r₁ + r₂)² whole. This module shares no code with `pairmask_core::sphere`
//! beyond the layout of a sphere.

use pairmask_core::Sphere;

/// Whether two spheres share a point, by the rules of [`pairmask_core::sphere`].
pub fn overlap(a: &Sphere, b: &Sphere) -> bool {
    let valid = |s: &Sphere| s.center.iter().all(|x| x.is_finite()) && s.radius >= 0.0;
    if !valid(a) || !valid(b) {
        return false;
    }
    if a.radius == f32::INFINITY || b.radius == f32::INFINITY {
        return true;
    }
    overlap_of_finite(a, b)
}

/// A finite f32 as m · 2^e in units of 2^−149, |m| below 2^24.
fn parts(x: f32) -> (i64, u32) {
    let bits = x.abs().to_bits();
    let (exponent, fraction) = (bits / (1 << 23), i64::from(bits % (1 << 23)));
    let (magnitude, exponent) =
        if exponent == 0 { (fraction, 0) } else { (fraction + (1 << 23), exponent - 1) };
    (if x < 0.0 { -magnitude } else { magnitude }, exponent)
}

/// Digits to the base 2^32 of a number in units of 2^−149, the lowest first: numbers are below 2^278. Digits have
/// signs and may be as large as a sum of two of them.
type Digits = [i64; 9];

/// Whether two valid, finite spheres share a point, regardless of their magnitudes: whether (r₁ + r₂)² − d² is 0 or more.
fn overlap_of_finite(a: &Sphere, b: &Sphere) -> bool {
    // A digit is a sum of at most 4 · 9 products below 2^68.
    let mut difference = [0i128; 18];
    let mut add_square = |x: Digits, sign: i128| {
        // Most are 0.
        for (i, p) in x.iter().enumerate().filter(|(_, p)| **p != 0) {
            for (j, q) in x.iter().enumerate() {
                difference[i + j] += sign * i128::from(*p) * i128::from(*q);
            }
        }
    };
    add_square(sum(a.radius, b.radius), 1);
    for axis in 0..3 {
        add_square(sum(a.center[axis], -b.center[axis]), -1);
    }
    // What is left of a digit after its carry is not negative, so the last carry has the sign of all.
    difference.iter().fold(0, |carry, digit| (digit + carry) >> 32) >= 0
}

fn sum(x: f32, y: f32) -> Digits {
    let mut digits = [0; 9];
    for (magnitude, exponent) in [parts(x), parts(y)] {
        let (at, shifted) = ((exponent / 32) as usize, magnitude << (exponent % 32));
        // Below 2^56; rounded down, so that the low digit is not negative.
        digits[at] += shifted & 0xffff_ffff;
        digits[at + 1] += shifted >> 32;
    }
    digits
}

#[cfg(test)]
mod tests {
    use pairmask_tests::spheres::hard_pairs;

    use super::*;

    #[test]
    fn hard_pairs_are_decided_as_the_library_decides_them() {
        let pairs = hard_pairs(2_000, 11);
        let overlapping = pairs.iter().filter(|(a, b)| {
            let overlaps = overlap(a, b);
            assert_eq!(overlaps, a.overlaps(b), "{a:?} {b:?}");
            overlaps
        });
        assert!((1_000..pairs.len() - 1_000).contains(&overlapping.count()));
    }

    #[test]
    fn the_widest_magnitudes_do_not_overflow() {
        let spread = |x: f32, radius: f32| Sphere::new([x; 3], radius);
        // 2 √3 radii apart, and 2 along one axis.
        let most = f32::MAX;
        assert!(!overlap(&spread(-most, most), &spread(most, most)));
        let along = |x: f32, radius: f32| Sphere::new([x, 0.0, 0.0], radius);
        assert!(overlap(&along(-most, most), &along(most, most)));
        assert!(!overlap(&along(-most, most), &along(most, most.next_down())));
        assert!(!overlap(&along(-most, 0.0), &along(1e-45, most)));
    }
}
