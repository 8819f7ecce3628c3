//! `shared/sphere_filter`: whether two spheres are apart, together or near, in f32.
//!
//! # Why it is never wrong
//!
//! WGSL promises of +, − and × that the result is one of the two numbers of f32 around the real one, that
//! a product and a sum may be one operation with one rounding, and that sums of three may be added in
//! another order. It promises neither subnormals, which may count as 0 as inputs and as results, nor
//! anything of infinities. So let u = 2^−23 bound the relative error of an operation, and let all numbers
//! be below 2^36, or 0; what is larger comes below.
//!
//! * D, the computed d², has five roundings at the most: a difference, squared, a product and two sums.
//!   Where nothing is subnormal, d²(1 − u)⁵ ≤ D ≤ d²(1 + u)⁵. All terms are ≥ 0.
//! * S, the computed (r₁ + r₂)², has three: s²(1 − u)³ ≤ S ≤ s²(1 + u)³.
//! * What is subnormal and counts as 0 changes a difference by less than 2^−124, its square by less than
//!   2^−123·|x| + 2^−126, and so D and S by less than 2^−120·max(d, s, 2^−6). Where d² or s² is 2^−81 or
//!   more, that is less than 2^−30 of it times u, say: D and S are within one more factor 1 ± u.
//!
//! With L = 1 − 2^−19 = 1 − 16u and T = 2^−80:
//!
//! * If fl(D·L − T) > S, then D·L(1 + u)² > T, so D > 2^−80 and d² > 2^−81, and D·L(1 + u)² > S + T·(1 − u).
//!   So d² ≥ D/(1 + u)⁶ > (S + T(1 − u))/(L(1 + u)⁸), and S ≥ s²(1 − u)⁴ where s² > 2^−81; where it is
//!   not, T alone is more than s². Then d² > s²(1 − u)⁴/((1 − 16u)(1 + u)⁸) > s², for twelve roundings are less
//!   than sixteen: **apart**.
//! * If fl(S·L − T) > D, then S > 2^−80, and by the same count d² ≤ s²: **together**.
//! * Else they are **near**: within 2^−18 of touching, or smaller than 2^−40. Integers decide
//!   ([`sphere_exact`](super::sphere_exact)).
//!
//! With numbers up to 2^36 nothing exceeds 2^76. A sphere with a larger one is **far**: it is compared as one
//! of radius C = 2^60, with its centre at (C, 0, 0) in a column and at (−C, 0, 0) in a row. Against a
//! sphere within 2^36, D and S are both within C²(1 ± 2^−23)² before rounding, and against another far one
//! both are 4C²; D·L ≤ S and S·L ≤ D in both, for two and eight roundings are less than sixteen: near. What
//! overlaps nothing is compared with a radius of −2^61, so that the reach is at most −2^60 with
//! regardless of what else. Its square is given the sign of the reach, which makes it less than any D: apart.

use pairmask_core::Sphere;

/// What f32 says of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// They share no point.
    Apart,
    /// They share a point.
    Together,
    /// Not decided.
    Near,
}

/// Bits of 2^36.
const SAFE_BITS: u32 = 0x5180_0000;
/// 2^60.
const FAR: f32 = 1_152_921_504_606_846_976.0;
/// −2^61.
const NOTHING_RADIUS: f32 = -2.0 * FAR;
/// 1 − 2^−19.
pub const LESS: f32 = 1.0 - 1.0 / 524_288.0;
/// 2^−80.
const LEAST: f32 = f32::from_bits((127 - 80) << 23);

/// An order of the operations that WGSL allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arithmetic {
    /// Products and sums in one operation.
    pub fused: bool,
    /// Subnormals are 0.
    pub flushed: bool,
}

impl Arithmetic {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self { fused: false, flushed: false },
        Self { fused: true, flushed: false },
        Self { fused: false, flushed: true },
        Self { fused: true, flushed: true },
    ];

    fn held(self, x: f32) -> f32 {
        if self.flushed && x.is_subnormal() { 0.0 } else { x }
    }

    fn sum(self, a: f32, b: f32) -> f32 {
        self.held(self.held(a) + self.held(b))
    }

    /// a·b + c.
    fn product_sum(self, a: f32, b: f32, c: f32) -> f32 {
        let [a, b, c] = [a, b, c].map(|x| self.held(x));
        if self.fused { self.held(a.mul_add(b, c)) } else { self.sum(self.held(a * b), c) }
    }
}

/// A sphere as it is compared, in a row or in a column.
fn compared(sphere: &Sphere, is_row: bool) -> [f32; 4] {
    if sphere.class() != pairmask_core::BoxClass::Valid {
        return [0.0, 0.0, 0.0, NOTHING_RADIUS];
    }
    let numbers: [f32; 4] = (*sphere).into();
    if numbers.iter().any(|x| x.abs().to_bits() > SAFE_BITS) {
        return [if is_row { -FAR } else { FAR }, 0.0, 0.0, FAR];
    }
    numbers
}

/// What f32 says of a row and a column, with `less` in the place of [`LESS`].
pub fn verdict(row: &Sphere, column: &Sphere, arithmetic: Arithmetic, less: f32) -> Verdict {
    let (row, column) = (compared(row, true), compared(column, false));
    let [x, y, z] = std::array::from_fn(|axis| arithmetic.sum(row[axis], -column[axis]));
    let reach = arithmetic.sum(row[3], column[3]);
    let distance = arithmetic.product_sum(x, x, 0.0);
    let distance = arithmetic.product_sum(y, y, distance);
    let distance = arithmetic.product_sum(z, z, distance);
    let square = arithmetic.product_sum(reach, reach.abs(), 0.0);
    if arithmetic.product_sum(distance, less, -LEAST) > square {
        Verdict::Apart
    } else if arithmetic.product_sum(square, less, -LEAST) > distance {
        Verdict::Together
    } else {
        Verdict::Near
    }
}
