//! Unsigned integers of 320 and 640 bits: what the last decision of a near tie needs, and no more.

use std::cmp::Ordering;

/// Limbs of a sum of two f32 in units of 2^−149: 278 bits.
const LIMBS: usize = 5;

/// A magnitude below 2^320.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fixed([u64; LIMBS]);

/// A sum of squares of such magnitudes: three squares of 278 bits have 558.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Square([u64; 2 * LIMBS]);

impl Fixed {
    /// `value` · 2^`shift`; the result must be below 2^320.
    pub fn shifted(value: u64, shift: u32) -> Self {
        let mut limbs = [0; LIMBS];
        let (limb, bit) = ((shift / 64) as usize, shift % 64);
        let wide = u128::from(value) << bit;
        limbs[limb] = wide as u64;
        if let Some(next) = limbs.get_mut(limb + 1) {
            *next = (wide >> 64) as u64;
        }
        Self(limbs)
    }

    /// The sum, which must be below 2^320.
    pub fn sum(&self, other: &Self) -> Self {
        Self(add(&self.0, &other.0))
    }

    pub fn difference(&self, other: &Self) -> Self {
        let (large, small) = match compare(&self.0, &other.0) {
            Ordering::Less => (other, self),
            _ => (self, other),
        };
        let mut limbs = [0; LIMBS];
        let mut borrow = false;
        for i in 0..LIMBS {
            let (difference, under) = large.0[i].overflowing_sub(small.0[i]);
            let (difference, again) = difference.overflowing_sub(u64::from(borrow));
            limbs[i] = difference;
            borrow = under || again;
        }
        Self(limbs)
    }

    /// The square, by the school's multiplication.
    pub fn square(&self) -> Square {
        let mut limbs = [0u64; 2 * LIMBS];
        for i in 0..LIMBS {
            let mut carry = 0u128;
            for j in 0..LIMBS {
                // At most (2^64 − 1)² + 2·(2^64 − 1) = 2^128 − 1.
                carry += u128::from(self.0[i]) * u128::from(self.0[j]) + u128::from(limbs[i + j]);
                limbs[i + j] = carry as u64;
                carry >>= 64;
            }
            limbs[i + LIMBS] = carry as u64;
        }
        Square(limbs)
    }
}

impl Square {
    /// 0.
    pub const ZERO: Self = Self([0; 2 * LIMBS]);

    /// The sum, which must be below 2^640.
    pub fn sum(&self, other: &Self) -> Self {
        Self(add(&self.0, &other.0))
    }
}

impl PartialOrd for Square {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(compare(&self.0, &other.0))
    }
}

fn add<const N: usize>(a: &[u64; N], b: &[u64; N]) -> [u64; N] {
    let mut limbs = [0; N];
    let mut carry = false;
    for i in 0..N {
        let (sum, over) = a[i].overflowing_add(b[i]);
        let (sum, again) = sum.overflowing_add(u64::from(carry));
        limbs[i] = sum;
        carry = over || again;
    }
    limbs
}

/// The highest limb decides.
fn compare<const N: usize>(a: &[u64; N], b: &[u64; N]) -> Ordering {
    a.iter().rev().cmp(b.iter().rev())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn low(x: &Square) -> u128 {
        u128::from(x.0[0]) | u128::from(x.0[1]) << 64
    }

    proptest! {
        #[test]
        fn small_numbers_behave_as_u128_does(a in any::<u32>(), b in any::<u32>(), c in 0..30u32) {
            let (x, y) = (Fixed::shifted(u64::from(a), c), Fixed::shifted(u64::from(b), c));
            let (a, b) = (u128::from(a) << c, u128::from(b) << c);
            prop_assert_eq!(low(&x.difference(&y).square()), a.abs_diff(b).pow(2));
            prop_assert_eq!(low(&x.sum(&y).square()), (a + b).pow(2));
            prop_assert_eq!(x.square() <= y.square(), a <= b);
        }

        /// (x + y)² + (x − y)² = 2x² + 2y²: across limbs, with carries and borrows.
        #[test]
        fn squares_of_large_numbers_fit_together(
            a in 0..1u64 << 24, p in 0..254u32, b in 0..1u64 << 24, q in 0..254u32,
        ) {
            let (x, y) = (Fixed::shifted(a, p), Fixed::shifted(b, q));
            let twice = |s: Square| s.sum(&s);
            let left = x.sum(&y).square().sum(&x.difference(&y).square());
            let right = twice(x.square()).sum(&twice(y.square()));
            prop_assert_eq!(left, right);
            prop_assert_eq!(x.difference(&y), y.difference(&x));
        }
    }
}
