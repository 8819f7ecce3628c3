//! IEEE half precision, rounded outward, by integers alone: it depends neither on the thread's
//! denormal flags nor on its rounding mode.
//!
//! Both directions are monotone, since each gives the closest half on its side: the largest one
//! that is not above x, the smallest one that is not below it. Beyond ±65,504, the largest half, x
//! goes to an infinity if that is outward, and to ±65,504 if not. Subnormal halves are numbers.

use super::exact::{GROUP_WORDS, Group, is_valid, widen, without_points};
use super::narrow::BoxF16;
use crate::aabb::{Aabb, INFINITY_BITS};

const HALF_INFINITY: u16 = 0x7c00;
/// Bits of f32 2⁻¹⁴, the smallest normal half.
const LEAST_NORMAL: u32 = 0x3880_0000;
/// Bits of f32 2¹⁶: from there on magnitudes are beyond the largest half whichever way they round.
const BEYOND: u32 = 0x4780_0000;
/// f32 exponents are biased by 127, those of halves by 15.
const BIAS_GAP: u32 = 112 << 23;
/// Fraction bits that a half does not have.
const DROPPED: u32 = 13;

/// The half of a magnitude (bits without sign, no NaN), towards zero or away from it.
#[inline(always)]
fn magnitude(bits: u32, away: bool) -> u16 {
    // Normal halves: take the bias gap off, and the low bits. A carry out of the fraction rightly
    // raises the exponent, up to infinity.
    let normal = bits.wrapping_sub(BIAS_GAP);
    let normal = (normal >> DROPPED) + u32::from(away && normal & ((1 << DROPPED) - 1) != 0);
    // Subnormal halves are multiples of 2⁻²⁴: shift the significand, its leading one included. A
    // shift past its 24 bits leaves 0; 31 stands for all such shifts.
    let exponent = bits >> 23;
    let significand = (bits & 0x007f_ffff) | u32::from(exponent != 0) << 23;
    let shift = 126u32.saturating_sub(exponent.max(1)).min(31);
    let subnormal = significand >> shift;
    let subnormal = subnormal + u32::from(away && subnormal << shift != significand);
    let beyond = HALF_INFINITY - u16::from(!away && bits != INFINITY_BITS);
    if bits >= BEYOND {
        beyond
    } else if bits >= LEAST_NORMAL {
        normal as u16
    } else {
        subnormal as u16
    }
}

/// The closest half outward of a number: downwards for a min, upwards for a max.
#[inline(always)]
fn half(x: f32, up: bool) -> u16 {
    let bits = x.to_bits();
    let is_negative = bits >> 31 != 0;
    magnitude(bits & 0x7fff_ffff, is_negative != up) | u16::from(is_negative) << 15
}

/// The f32 of the same value. Every half has one.
#[inline(always)]
pub(super) fn expand(half: u16) -> f32 {
    let sign = u32::from(half & 0x8000) << 16;
    let magnitude = u32::from(half & 0x7fff);
    let exponent = magnitude >> 10;
    // Infinity and NaN keep the largest exponent; a NaN keeps a fraction bit.
    let gap = if exponent == 31 { 2 * BIAS_GAP } else { BIAS_GAP };
    let normal = (magnitude << DROPPED).wrapping_add(gap);
    // k · 2⁻²⁴ for k < 1024 is a normal f32, and exact.
    let subnormal = (magnitude as f32 * SUBNORMAL_HALF_UNIT).to_bits();
    f32::from_bits(sign | if exponent == 0 { subnormal } else { normal })
}

/// Value of the last place of every subnormal half: 2⁻²⁴.
const SUBNORMAL_HALF_UNIT: f32 = f32::from_bits((127 - 24) << 23);

/// A group of valid boxes in halves.
#[inline(always)]
pub(super) fn narrow_group(group: &Group) -> [u16; GROUP_WORDS] {
    let mut halves = [0; GROUP_WORDS];
    for at in 0..GROUP_WORDS {
        halves[at] = half(group[at], at % 6 >= 3);
    }
    halves
}

#[inline(always)]
pub(super) fn narrow(b: &Aabb) -> BoxF16 {
    let (min, max) = (b.min.map(widen), b.max.map(widen));
    if !is_valid(&min, &max) {
        return without_points(b, BoxF16::EMPTY, BoxF16::INVALID);
    }
    BoxF16 { min: b.min.map(|x| half(x, false)), max: b.max.map(|x| half(x, true)) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Value of a half by the definition in IEEE 754, not by bits.
    fn value(half: u16) -> f64 {
        let (exponent, fraction) = (i32::from(half >> 10 & 31), f64::from(half & 1023));
        let magnitude = match exponent {
            0 => fraction * 2.0f64.powi(-24),
            31 if fraction == 0.0 => f64::INFINITY,
            31 => f64::NAN,
            e => (1024.0 + fraction) * 2.0f64.powi(e - 25),
        };
        if half >> 15 == 0 { magnitude } else { -magnitude }
    }

    #[test]
    fn every_half_expands_to_its_value() {
        for bits in 0..=u16::MAX {
            let (expanded, expected) = (f64::from(expand(bits)), value(bits));
            assert!(
                expanded == expected || expanded.is_nan() && expected.is_nan(),
                "{bits:#06x}: {expanded} {expected}"
            );
            assert_eq!(expand(bits).is_sign_negative(), bits >> 15 != 0, "{bits:#06x}");
        }
    }

    /// The neighbour of a half that is no NaN, downwards.
    fn next_down(bits: u16) -> Option<u16> {
        match bits {
            0xfc00 => None,
            0 | 0x8000 => Some(0x8001),
            b if b >> 15 == 0 => Some(b - 1),
            b => Some(b + 1),
        }
    }

    fn check(x: f32) {
        let exact = f64::from(x);
        let (down, up) = (half(x, false), half(x, true));
        assert!(value(down) <= exact && exact <= value(up), "{x:e}: {down:#06x} {up:#06x}");
        if value(down) == exact {
            assert_eq!(value(up), exact, "{x:e}");
        } else {
            assert_eq!(next_down(up).map(value), Some(value(down)), "{x:e}: neighbours");
        }
    }

    #[test]
    fn borders_round_outward_to_the_nearest() {
        for bits in (0..=0x7c00u16).chain(0x8000..=0xfc00) {
            let x = expand(bits);
            for x in [x, x.next_up(), x.next_down(), x * 1.0001] {
                check(x);
            }
        }
        for x in [f32::MAX, f32::MIN, 65_504.0, 65_519.9, 65_520.0, 65_536.0, 1e-45, -1e-45, 2e-24]
        {
            check(x);
        }
        assert_eq!((half(1e6, false), half(1e6, true)), (0x7bff, 0x7c00));
        assert_eq!((half(-1e6, false), half(-1e6, true)), (0xfc00, 0xfbff));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(50_000))]
        #[test]
        fn any_number_rounds_outward_to_the_nearest(bits in any::<u32>()) {
            let x = f32::from_bits(bits);
            prop_assume!(!x.is_nan());
            check(x);
        }
    }

    #[test]
    fn classes_survive() {
        let barely = Aabb::from([1.0f32.next_up(), 0.0, 0.0, 1.0, 1.0, 1.0]);
        assert_eq!(narrow(&barely), BoxF16::EMPTY, "halves alone would make it valid");
        let mut invalid = Aabb::from([0.0; 6]);
        invalid.min[0] = f32::NAN;
        assert_eq!(narrow(&invalid), BoxF16::INVALID);
    }
}
