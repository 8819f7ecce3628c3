//! `shared/sphere_bounds`: the box around a sphere, rounded outward.
//!
//! # Why no pair is lost
//!
//! Spheres that overlap have |x₁ − x₂| ≤ r₁ + r₂ on each axis, so their intervals [x − r, x + r] of real
//! numbers meet. The grid looks at [`plain`](super::grid_layout::plain) numbers alone, which is monotone,
//! 0 below 2^−60, and the same for all beyond 2^60. So it is enough that plain(low) ≤ plain(x − r) for the
//! computed `low`, and the like for `high`; the rest is the proof that boxes have.
//!
//! * Above 2^126 the box is all of space. Below, the sum is finite, and WGSL rounds it to one of its two
//!   neighbours: it is off by less than one step. A subnormal may count as 0, as input or as sum: that is
//!   off by less than 2^−125 once more.
//! * Where |x − r| ≥ 2^−61 a step is at least 2^−85, so both are less than two steps of f32, and two are
//!   taken outward: low ≤ x − r.
//! * Where |x − r| < 2^−61, |low| is below 2^−60 with its two steps, and both have the plain number 0.

use pairmask_core::aabb::{KeyBox, order_key};
use pairmask_core::{BoxClass, Sphere};

/// Bits of 2^126.
const BOUNDED_BITS: u32 = 0x7e80_0000;
/// Steps of f32 outward.
const OUTWARD: i32 = 2;

/// Bits that are `steps` further up.
fn stepped(x: f32, steps: i32) -> i32 {
    // Bits as the stage hands them on: −0 is +0 there.
    order_key(order_key((order_key(x.to_bits()) + steps) as u32) as u32)
}

/// The keys of the box around a sphere, and the sphere's class.
pub fn classify(sphere: &Sphere) -> (KeyBox, BoxClass) {
    let class = sphere.class();
    if class != BoxClass::Valid {
        return (KeyBox::NOTHING, class);
    }
    let numbers: [f32; 4] = (*sphere).into();
    if numbers.iter().any(|x| x.abs().to_bits() >= BOUNDED_BITS) {
        let [low, high] = [f32::NEG_INFINITY, f32::INFINITY].map(|x| [order_key(x.to_bits()); 3]);
        return (KeyBox { min: low, max: high }, class);
    }
    let radius = sphere.radius.abs();
    let min = sphere.center.map(|x| stepped(x - radius, -OUTWARD));
    let max = sphere.center.map(|x| stepped(x + radius, OUTWARD));
    (KeyBox { min, max }, class)
}
