//! Conversion of f32 to exact f64, and the class of a box by them: fast, and the same on every
//! thread.
//!
//! A thread that treats subnormals as zero (as audio and game threads often do) would compare and
//! convert them as zero. Two threads that fill one frame could then round the same coordinate
//! differently.

use crate::aabb::{Aabb, BoxClass};

/// Value of the last place of every subnormal f32: 2⁻¹⁴⁹.
const SUBNORMAL_UNIT: f64 = f64::from_bits((1023 - 149) << 52);
/// Bits of the smallest f32 that is not subnormal.
const LEAST_NORMAL: u32 = 0x0080_0000;

/// The same number as an f64, independent of the thread's denormal flags. The f64 of an f32 is
/// never subnormal, so that no flag changes it.
#[inline(always)]
pub(crate) fn widen(x: f32) -> f64 {
    let bits = x.to_bits();
    let magnitude = bits & 0x7fff_ffff;
    let signed = if bits == magnitude { magnitude as i32 } else { -(magnitude as i32) };
    if magnitude < LEAST_NORMAL { f64::from(signed) * SUBNORMAL_UNIT } else { f64::from(x) }
}

/// Whether `min <= max` on every axis: false for empty boxes, and for NaN.
#[inline(always)]
pub(super) fn is_valid(min: &[f64; 3], max: &[f64; 3]) -> bool {
    let mut valid = true;
    for axis in 0..3 {
        // Without short circuit: a branch for each axis would cost more.
        valid &= min[axis] <= max[axis];
    }
    valid
}

/// Boxes that are converted together: enough for the compiler to fill its registers.
pub(super) const GROUP: usize = 8;
/// Their coordinates, box by box.
pub(super) const GROUP_WORDS: usize = 6 * GROUP;
/// The coordinates of a group, box by box.
pub(super) type Group = [f32; GROUP_WORDS];

/// Whether every box of a group is valid.
///
/// Plain loops over arrays of one length: compilers turn them into SIMD code.
#[inline(always)]
pub(super) fn is_valid_group(group: &Group) -> bool {
    let mut wide = [0.0; GROUP_WORDS];
    for at in 0..GROUP_WORDS {
        wide[at] = widen(group[at]);
    }
    // At the place of each min, the max of its axis.
    let mut max = [0.0; GROUP_WORDS];
    max[..GROUP_WORDS - 3].copy_from_slice(&wide[3..]);
    let mut wrong = 0;
    for at in 0..GROUP_WORDS {
        let is_in_order = wide[at] <= max[at];
        let is_min = at % 6 < 3;
        wrong |= u32::from(!is_in_order) & u32::from(is_min);
    }
    wrong == 0
}

/// The form of a box that is not valid.
#[cold]
pub(super) fn without_points<B>(b: &Aabb, empty: B, invalid: B) -> B {
    if b.class() == BoxClass::Invalid { invalid } else { empty }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn widening_is_exact(bits in prop_oneof![any::<u32>(), 0u32..100, 0x8000_0000u32..0x8000_0100]) {
            let x = f32::from_bits(bits);
            prop_assume!(!x.is_nan());
            prop_assert_eq!(widen(x), f64::from(x));
        }
    }
}
