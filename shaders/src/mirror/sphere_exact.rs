//! `shared/sphere_exact`: whether two spheres meet, in integers.
//!
//! # Why it is exact
//!
//! A finite f32 is ±m·2^(s − 149) with m < 2^24 and 0 ≤ s ≤ 253. Divided by the least 2^s of those of the
//! eight numbers that are not 0, all are integers, below 2^(24 + h − l) for the greatest s = h and the least
//! s = l. As digits of 11 bits that is (24 + h − l)/11 of them, rounded up: at most 26.
//!
//! x₁ − x₂, y₁ − y₂, z₁ − z₂ and r₁ + r₂ are taken digit by digit. Such a digit is at most 2·2047 < 2^12 in
//! magnitude, of either sign: the number is the sum of digit·2^(11 i) all the same, and its square the sum of
//! products of two digits. A digit of d² − (r₁ + r₂)² is a sum of at most 3·26 products below 2^24 of one
//! sign, less than 2^30.3, and a carry of less than 2^20: it fits an i32. What is left after the last
//! digit has the sign of the whole; it is 0 when all digits are.

use pairmask_core::{BoxClass, Sphere};

const DIGIT_BITS: u32 = 11;
const DIGIT: i32 = (1 << DIGIT_BITS) - 1;
const MOST_DIGITS: usize = 26;

/// Magnitude and shift of a finite f32.
fn parts(x: f32) -> (u32, u32) {
    let (exponent, fraction) = (x.to_bits() >> 23 & 255, x.to_bits() & 0x7f_ffff);
    (fraction | u32::from(exponent != 0) << 23, exponent.max(1) - 1)
}

/// Digit of mantissa·2^up that weighs 2^low.
fn digit(mantissa: u32, up: u32, low: u32) -> i32 {
    let cut =
        if low >= up { mantissa >> (low - up).min(31) } else { mantissa << (up - low).min(31) };
    cut as i32 & DIGIT
}

/// Whether two spheres share a point.
pub fn meet(a: &Sphere, b: &Sphere) -> bool {
    if [a, b].iter().any(|sphere| sphere.class() != BoxClass::Valid) {
        return false;
    }
    if a.radius.is_infinite() || b.radius.is_infinite() {
        return true;
    }
    let (a, b): ([f32; 4], [f32; 4]) = ((*a).into(), (*b).into());
    let shifts = || a.iter().chain(&b).map(|x| parts(*x)).filter(|(m, _)| *m != 0).map(|p| p.1);
    let (Some(low), Some(high)) = (shifts().min(), shifts().max()) else {
        return true;
    };
    let count = (((high - low + 34) / DIGIT_BITS) as usize).min(MOST_DIGITS);
    let number = |axis: usize, i: usize| {
        let of = |x: f32| {
            let (mantissa, shift) = parts(x);
            let up = if mantissa == 0 { 0 } else { shift - low };
            let digit = digit(mantissa, up, DIGIT_BITS * i as u32);
            if x.is_sign_negative() { -digit } else { digit }
        };
        if axis == 3 { of(a[3].abs()) + of(b[3].abs()) } else { of(a[axis]) - of(b[axis]) }
    };
    let (mut carry, mut is_zero) = (0i32, true);
    for k in 0..2 * count - 1 {
        for i in (k + 1).max(count) - count..=k.min(count - 1) {
            let product = |axis| number(axis, i) * number(axis, k - i);
            carry += product(0) + product(1) + product(2) - product(3);
        }
        is_zero = is_zero && carry & DIGIT == 0;
        carry >>= DIGIT_BITS;
    }
    carry < 0 || carry == 0 && is_zero
}
