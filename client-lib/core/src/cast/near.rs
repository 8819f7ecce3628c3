//! Spheres: the distance of a box from a point (Arvo 1990), rounded down for bounds and exact for boxes.

use std::cmp::Ordering;

use super::exact::{ERROR, sign_of_sum};
use super::node::{FAN_OUT, Keys, MISSED, Node, key};
use super::probe::{Probe, ROUNDING, limit_above};
use crate::aabb::{Aabb, BoxClass};
use crate::sphere::Sphere;

/// Powers of two that coordinates are scaled to and by: squares of what is up to 2^63 times smaller are still numbers.
const LARGEST: i32 = 60;
const SCALES: std::ops::RangeInclusive<i32> = -126..=126;
const EXPONENT_BIAS: i32 = 127;
const MANTISSA_BITS: u32 = 23;

/// A valid sphere. Its distances are squares; those of bounds are scaled.
#[derive(Clone, Copy)]
pub(super) struct SphereProbe {
    sphere: Sphere,
    scale: f32,
}

impl SphereProbe {
    /// A sphere among boxes whose finite coordinates are up to `reach` from 0; `None` where it finds nothing.
    pub fn new(sphere: &Sphere, reach: f32) -> Option<Self> {
        let farthest = sphere.center.iter().fold(reach, |most, x| most.max(x.abs()));
        let exponent = (farthest.to_bits() >> MANTISSA_BITS) as i32 - EXPONENT_BIAS;
        let scale = (LARGEST - exponent).clamp(*SCALES.start(), *SCALES.end());
        let scale = f32::from_bits(((scale + EXPONENT_BIAS) as u32) << MANTISSA_BITS);
        (sphere.class() == BoxClass::Valid).then_some(Self { sphere: *sphere, scale })
    }

    fn gaps(&self, b: &Aabb) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let (center, min, max) = (self.sphere.center[axis], b.min[axis], b.max[axis]);
            let [center, min, max] = [center, min, max].map(f64::from);
            f64::max(min - center, center - max).max(0.0)
        })
    }

    /// The square of the distance of a box, as terms of a sum.
    fn terms(&self, b: &Aabb) -> [f64; 9] {
        let mut terms = [0.0; 9];
        for axis in 0..3 {
            let (center, min, max) = (self.sphere.center[axis], b.min[axis], b.max[axis]);
            let face = if min > center { min } else { max };
            if min > center || max < center {
                // Products of two f32 are f64.
                let [center, face] = [center, face].map(f64::from);
                terms[3 * axis..][..3].copy_from_slice(&[
                    face * face,
                    -2.0 * face * center,
                    center * center,
                ]);
            }
        }
        terms
    }
}

impl Probe for SphereProbe {
    #[inline(always)]
    fn keys(&self, boxes: &Node, limit: f32, keys: &mut Keys) {
        let mut squares = [0.0; FAN_OUT];
        for axis in 0..3 {
            let (mins, maxes) = (&boxes.min[axis], &boxes.max[axis]);
            let (center, scale) = (self.sphere.center[axis], self.scale);
            for lane in 0..FAN_OUT {
                let (below, above) = (mins[lane] - center, center - maxes[lane]);
                let gap = if below > above { below } else { above };
                let gap = (if gap > 0.0 { gap } else { 0.0 }) * scale;
                squares[lane] += gap * gap;
            }
        }
        for lane in 0..FAN_OUT {
            let lower = squares[lane] * (1.0 - ROUNDING);
            keys[lane] = if lower <= limit { key(lower, lane) } else { MISSED };
        }
    }

    fn most(&self) -> f32 {
        let radius = f64::from(self.sphere.radius);
        self.limit_of(radius * radius)
    }

    fn limit_of(&self, distance: f64) -> f32 {
        let scale = f64::from(self.scale);
        limit_above(distance * scale * scale)
    }

    fn measure(&self, b: &Aabb) -> Option<f64> {
        let square: f64 = self.gaps(b).iter().map(|gap| gap * gap).sum();
        let radius = f64::from(self.sphere.radius);
        let most = radius * radius;
        let is_hit = if square == f64::INFINITY || square > most * (1.0 + ERROR) {
            false
        } else {
            let exactly = || sign_of_sum(self.terms(b).into_iter().chain([-most])).is_le();
            square < most * (1.0 - ERROR) || exactly()
        };
        is_hit.then_some(square)
    }

    fn compare(&self, a: &Aabb, b: &Aabb) -> Ordering {
        let others = self.terms(b).map(|term| -term);
        sign_of_sum(self.terms(a).into_iter().chain(others))
    }

    fn reported(&self, distance: f64) -> f32 {
        distance.sqrt() as f32
    }
}
