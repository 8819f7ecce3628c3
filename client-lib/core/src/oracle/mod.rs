//! The one naive oracle: two loops, one comparison, no keys, no SIMD, no index formula.
//!
//! It is the reference of the tests, of `pairmask-lab stress` and of the daemon's auditor, and answers
//! no client. It shares no code with the engines beyond the layout of a box. It compares f64, which
//! hold every f32 exactly. It runs on threads of all floating-point flags, so nothing here depends on
//! those: f64 are compared as whole numbers of the same order.
//!
//! [`naive_decoder`] decodes masks as plainly. [`check`] compares an engine's answer with the truth
//! and names the first wrong pair. [`modes`] gives the pairs that a precision mode must and may
//! report.

pub mod check;
pub mod modes;
pub mod naive_decoder;

use crate::aabb::Aabb;
use crate::engine::{Census, NAMED_INVALID};

/// A pair of box indices, the lower one first.
pub type Pair = [u32; 2];

/// The right answer to a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Truth {
    /// Overlapping pairs, sorted.
    pub pairs: Vec<Pair>,
    /// Counts of empty and invalid boxes.
    pub census: Census,
}

/// The answer for `boxes`, by comparing every box with every other.
///
/// # Panics
/// With 2^32 boxes or more.
pub fn truth(boxes: &[Aabb]) -> Truth {
    truth_of_faces(&boxes.iter().map(faces).collect::<Vec<Faces>>())
}

/// Min and max of a box in f64, which holds every f32 exactly.
pub type Faces = [[f64; 3]; 2];

fn faces(b: &Aabb) -> Faces {
    [b.min.map(exact), b.max.map(exact)]
}

/// The f64 of the same value as an f32. A conversion would make a subnormal zero on some threads; a
/// subnormal is a whole number times 2⁻¹⁴⁹, and that product is exact.
fn exact(x: f32) -> f64 {
    let fraction = x.to_bits() & 0x007f_ffff;
    let is_subnormal = x.to_bits() << 1 >> 24 == 0;
    let magnitude = f64::from(fraction) * f64::from_bits((1023 - 149) << 52);
    let subnormal = if x.is_sign_negative() { -magnitude } else { magnitude };
    if is_subnormal { subnormal } else { f64::from(x) }
}

/// `x <= y` for numbers; false for NaN. Zeros of both signs are equal.
fn at_most(x: f64, y: f64) -> bool {
    // Compilers turn `bits << 1 == 0` into a comparison of floats, which a subnormal passes on some
    // threads. So there is no test for zero: both zeros get rank 0, and −∞ gets the least rank.
    let rank = |x: f64| {
        let bits = x.to_bits() as i64;
        if bits < 0 { i64::MIN - bits } else { bits }
    };
    !x.is_nan() && !y.is_nan() && rank(x) <= rank(y)
}

/// As [`truth`], for boxes given in f64.
///
/// # Panics
/// With 2^32 boxes or more.
pub fn truth_of_faces(boxes: &[Faces]) -> Truth {
    let corners: Vec<Corners> = boxes.iter().map(Corners::of_faces).collect();
    Truth { pairs: pairs_of(&corners), census: census(boxes) }
}

fn pairs_of(corners: &[Corners]) -> Vec<Pair> {
    let n = u32::try_from(corners.len()).expect("indices are u32");
    let mut pairs = Vec::new();
    for a in 0..n {
        for b in a + 1..n {
            if corners[a as usize].overlap(&corners[b as usize]) {
                pairs.push([a, b]);
            }
        }
    }
    pairs
}

/// A box as the oracle compares it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners {
    /// `None` for a box that is invalid or empty.
    valid: Option<[[f64; 3]; 2]>,
}

impl Corners {
    /// The corners of a box.
    pub fn of(b: &Aabb) -> Self {
        Self::of_faces(&faces(b))
    }

    /// The corners of a box given in f64.
    fn of_faces(faces: &Faces) -> Self {
        let [min, max] = faces;
        let valid = (0..3).all(|axis| at_most(min[axis], max[axis]));
        Self { valid: valid.then_some(*faces) }
    }

    /// Whether two boxes share a point.
    pub fn overlap(&self, other: &Self) -> bool {
        let (Some(p), Some(q)) = (&self.valid, &other.valid) else { return false };
        (0..3).all(|axis| at_most(p[0][axis], q[1][axis]) && at_most(q[0][axis], p[1][axis]))
    }
}

fn census(boxes: &[Faces]) -> Census {
    let is_invalid = |b: &&Faces| b.as_flattened().iter().any(|x| x.is_nan());
    let invalid: Vec<u32> =
        (0u32..).zip(boxes).filter(|(_, b)| is_invalid(b)).map(|(i, _)| i).collect();
    let is_empty = |b: &&Faces| !is_invalid(b) && Corners::of_faces(b).valid.is_none();
    let empty = boxes.iter().filter(is_empty).count();
    let mut first_invalid = [0; NAMED_INVALID];
    for (slot, index) in first_invalid.iter_mut().zip(&invalid) {
        *slot = *index;
    }
    Census { invalid: invalid.len() as u32, empty: empty as u32, first_invalid }
}

/// FNV-1a (Fowler, Noll, Vo; 64 bits) over the pairs as little-endian u32: a fingerprint that is
/// the same on every machine and with every compiler.
pub fn pair_set_hash(pairs: &[Pair]) -> u64 {
    let bytes = pairs.iter().flat_map(|&[a, b]| [a, b]).flat_map(u32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rules_of_the_wire_hold() {
        let unit = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let touching = Aabb::from([1.0, -0.0, -0.0, 2.0, 1.0, 1.0]);
        let apart = Aabb::from([1.0f32.next_up(), 0.0, 0.0, 2.0, 1.0, 1.0]);
        let plane = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        let mut invalid = Aabb::EMPTY;
        invalid.min[2] = f32::NAN;
        let boxes = [unit, touching, apart, plane, Aabb::EMPTY, invalid];
        let truth = truth(&boxes);
        assert_eq!(truth.pairs, [[0, 1], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert_eq!((truth.census.empty, truth.census.invalid), (1, 1));
        assert_eq!(truth.census.named_invalid(), [5]);
    }

    #[test]
    fn f64_are_those_of_f32_and_compared_as_numbers() {
        for x in [0.0, -0.0, 1e-45, -1e-45, 1e-40, -1e-38, f32::MIN_POSITIVE, -2.5, f32::MAX] {
            assert_eq!(exact(x).to_bits(), f64::from(x).to_bits(), "{x:e}");
            for y in [0.0, -0.0, 1e-45, f32::NEG_INFINITY, f32::INFINITY, f32::NAN, -2.5] {
                assert_eq!(at_most(exact(x), exact(y)), x <= y, "{x:e} {y:e}");
                assert_eq!(at_most(exact(y), exact(x)), y <= x, "{y:e} {x:e}");
            }
        }
        assert!(at_most(-5e-324, 0.0) && !at_most(5e-324, -0.0) && !at_most(f64::NAN, f64::NAN));
    }
}
