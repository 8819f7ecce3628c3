//! Families of sphere pairs, each hard to decide for its own reason.

use pairmask_core::sphere::Sphere;
use pairmaskd::scene::Random;

use crate::stress::hard::{any_finite, power_of_ten, ulps};

#[derive(Clone, Copy)]
pub struct Family {
    pub name: &'static str,
    /// Whether its pairs touch, or miss touching by one ulp, by construction.
    pub tangent: bool,
    pub make: fn(&mut Random) -> (Sphere, Sphere),
}

pub const ALL: &[Family] = &[
    // Like magnitudes, overlapping about as often as not.
    random("unit scene", |random| {
        let mut one = || {
            let center = std::array::from_fn(|_| random.unit());
            Sphere::new(center, 0.7 * random.unit())
        };
        (one(), one())
    }),
    // Finite numbers of any magnitude, radii not below 0.
    random("any f32", |random| {
        let mut one = || {
            let center = std::array::from_fn(|_| any_finite(random));
            Sphere::new(center, any_finite(random).abs())
        };
        (one(), one())
    }),
    // One radius made so that the two touch as nearly as f32 can say, then moved by up to 2 ulps. Numbers around 1
    // times 2^k, which stay finite and may become subnormal.
    random("near ties", |random| {
        let scale = f32::from_bits((1 + random.below(250) as u32) << 23);
        let mut number = || (2.0 * random.unit() - 1.0) * scale;
        let (p, q): ([f32; 3], [f32; 3]) =
            (std::array::from_fn(|_| number()), std::array::from_fn(|_| number()));
        let distance =
            (0..3).map(|axis| (f64::from(p[axis]) - f64::from(q[axis])).powi(2)).sum::<f64>();
        let distance = distance.sqrt();
        let first = (distance * f64::from(random.unit())) as f32;
        let second = (distance - f64::from(first)) as f32;
        let second = ulps(second, random.below(5) as i32 - 2).max(0.0);
        (Sphere::new(p, first), Sphere::new(q, second))
    }),
    // Spheres of about a unit, 10^3 to 10^7 from the origin.
    random("far from the origin", |random| {
        let offset = power_of_ten(3 + random.below(5) as u32);
        let mut one = || {
            let center = std::array::from_fn(|_| offset + 4.0 * random.unit());
            Sphere::new(center, 1.0 + random.unit())
        };
        (one(), one())
    }),
    Family { name: "tangent", tangent: true, make: |random| tangent(random, 0) },
    Family {
        name: "tangent but for an ulp",
        tangent: true,
        make: |random| {
            let steps = if random.below(2) == 0 { -1 } else { 1 };
            tangent(random, steps)
        },
    },
];

const fn random(name: &'static str, make: fn(&mut Random) -> (Sphere, Sphere)) -> Family {
    Family { name, tangent: false, make }
}

/// Spheres that touch in exactly one point, the second radius then moved by so many `steps` of f32.
///
/// a² + b² + c² = d² in whole numbers (Lebesgue's quadruples: a = m² + n² − p² − q²,
/// b = 2(mq + np), c = 2(nq − mp), d = m² + n² + p² + q²), all below 2^24, so that centres and radii
/// are exact; all of it times a power of two.
pub fn tangent(random: &mut Random, steps: i32) -> (Sphere, Sphere) {
    // d < 4·1023² < 2^22, and an offset below 2^23 keeps every centre below 2^24.
    let limit = 1 << (1 + random.below(10));
    let [m, n, p, q] = std::array::from_fn(|_| random.below(limit) as i32);
    let step = [m * m + n * n - p * p - q * q, 2 * (m * q + n * p), 2 * (n * q - m * p)];
    let d = m * m + n * n + p * p + q * q;
    let mut axes = [0, 1, 2];
    axes.swap(0, random.below(3) as usize);
    // Below 2^127 where the numbers are below 2^24; below 2^−126 all of it is subnormal.
    let exponent = random.below(250) as i32 - 149;
    let scale = f64::from_bits(((exponent.min(103) + 1023) as u64) << 52);
    let exact = |x: i32| (f64::from(x) * scale) as f32;
    let start: [i32; 3] = std::array::from_fn(|_| random.below(1 << 23) as i32 - (1 << 22));
    let end: [i32; 3] = std::array::from_fn(|axis| start[axis] + step[axes[axis]]);
    let first = random.below(d as u64 + 1) as i32;
    let second = ulps(exact(d - first), steps);
    (Sphere::new(start.map(exact), exact(first)), Sphere::new(end.map(exact), second.max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::spheres::oracle::overlap;

    #[test]
    fn tangent_spheres_touch_and_an_ulp_less_keeps_them_apart() {
        let mut random = Random::new(1);
        for _ in 0..2_000 {
            let seed = random.bits();
            let (a, b) = tangent(&mut Random::new(seed), 0);
            assert!(overlap(&a, &b), "{a:?} {b:?}");
            let (a, less) = tangent(&mut Random::new(seed), -1);
            assert!(!overlap(&a, &less) || b.radius == 0.0, "{a:?} {less:?}");
        }
    }
}
