//! Overlap of spheres in plain exact rational arithmetic, the reference for the client library's
//! decision.
//!
//! Every finite f32 is a whole number of 2^−149, so that a common denominator of 2^298 makes the
//! rational numbers d² and (r₁ + r₂)² whole. This module shares no code with `pairmask_core::sphere`
//! beyond the layout of a sphere.
//!
//! Where the eight numbers of a pair are of like magnitude, a coarser common denominator makes them
//! whole within 64 bits and their squares within 128; that is most pairs. All others take integers of
//! 608 bits, which hold every sum of squares; the tests compare both ways.

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
    let along = |axis: usize| {
        let [x, y] = [a.center[axis], b.center[axis]];
        let (p, q) = (Whole::of(x), Whole::of(y));
        if (x < 0.0) == (y < 0.0) { p.distance(&q) } else { p.plus(&q) }
    };
    let squares = [0, 1, 2].map(|axis| along(axis).square());
    let reach = Whole::of(a.radius).plus(&Whole::of(b.radius));
    squares[0].plus(&squares[1]).plus(&squares[2]) <= reach.square()
}

/// Digits of a [`Whole`], 32 bits each. A finite f32 is below 2^277, a distance below 2^278, and the sum of
/// three squares below 2^558: within 608 bits.
const DIGITS: usize = 19;

/// A whole number that is not negative, the highest digit first, so that they compare as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Whole([u32; DIGITS]);

impl Whole {
    /// The magnitude of a finite f32 in units of 2^−149.
    fn of(x: f32) -> Self {
        let (magnitude, exponent) = parts(x.abs());
        let (digit, shift) = (exponent as usize / 32, exponent % 32);
        // Below 2^24 · 2^31.
        let shifted = (magnitude as u64) << shift;
        let mut whole = Self([0; DIGITS]);
        whole.0[DIGITS - 1 - digit] = shifted as u32;
        whole.0[DIGITS - 2 - digit] = (shifted >> 32) as u32;
        whole
    }

    fn plus(&self, other: &Self) -> Self {
        let mut sum = Self([0; DIGITS]);
        let mut carry = 0;
        for at in (0..DIGITS).rev() {
            carry += u64::from(self.0[at]) + u64::from(other.0[at]);
            sum.0[at] = carry as u32;
            carry >>= 32;
        }
        sum
    }

    /// The larger less the smaller.
    fn distance(&self, other: &Self) -> Self {
        let (large, small) = if self > other { (self, other) } else { (other, self) };
        let mut distance = Self([0; DIGITS]);
        let mut borrow = 0;
        for at in (0..DIGITS).rev() {
            let digit = i64::from(large.0[at]) - i64::from(small.0[at]) + borrow;
            distance.0[at] = digit as u32;
            borrow = digit >> 32;
        }
        distance
    }

    /// Of a number below 2^304.
    fn square(&self) -> Self {
        let digit = |place: usize| u64::from(self.0[DIGITS - 1 - place]);
        let mut square = Self([0; DIGITS]);
        // The digits of a place, products of 64 bits, and what the place before leaves.
        let mut carry: u128 = 0;
        for place in 0..DIGITS {
            let products = (0..=place).map(|i| u128::from(digit(i) * digit(place - i)));
            carry += products.sum::<u128>();
            square.0[DIGITS - 1 - place] = carry as u32;
            carry >>= 32;
        }
        square
    }
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

    /// Pairs whose magnitudes are as far apart as can be: the smallest number decides.
    #[test]
    fn a_least_number_decides_beside_the_largest() {
        let least = f32::from_bits(1);
        for large in [1.0, 1e30, f32::MAX / 4.0] {
            let on = |y: f32, radius: f32| Sphere::new([large, y, 0.0], radius);
            let origin = Sphere::new([0.0; 3], large);
            assert!(overlap_of_any(&origin, &on(0.0, 0.0)), "they touch");
            assert!(!overlap_of_any(&origin, &on(least, 0.0)), "they miss by the least number");
            assert!(overlap_of_any(&origin, &on(least, least)));
            let opposite = Sphere::new([-large, 0.0, 0.0], large);
            assert!(overlap_of_any(&opposite, &on(0.0, large)), "they touch");
            assert!(!overlap_of_any(&opposite, &on(0.0, large.next_down())));
        }
    }

    #[test]
    fn whole_numbers_are_those_of_the_format_and_their_squares_are_right() {
        let digits = |x: f32| Whole::of(x).0.to_vec();
        let with = |place: usize, digit: u32| {
            let mut digits = vec![0; DIGITS];
            digits[DIGITS - 1 - place] = digit;
            digits
        };
        assert_eq!(digits(0.0), with(0, 0));
        assert_eq!(digits(-1e-45), with(0, 1));
        assert_eq!(digits(f32::MIN_POSITIVE), with(0, 1 << 23));
        assert_eq!(digits(1.0), with(149 / 32, 1 << (149 % 32)));
        // 2^277 − 2^253.
        assert_eq!(digits(f32::MAX)[DIGITS - 9..DIGITS - 6], [(1 << 21) - 1, 7 << 29, 0]);
        for x in [3.0f32, 1e-20, 65_537.0] {
            let (root, whole) = (f64::from(x), Whole::of(x));
            let limbs = whole.square().0.iter().rev().enumerate();
            let square: f64 =
                limbs.map(|(i, d)| f64::from(*d) * 2f64.powi(32 * i as i32 - 298)).sum();
            assert!((square / (root * root) - 1.0).abs() < 1e-12, "{x}: {square}");
        }
    }
}
