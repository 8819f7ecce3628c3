//! The naive answer to casts, in exact fractions of whole numbers, and odd rays and spheres.

use std::cmp::Ordering;

use num_bigint::{BigInt, Sign};
use pairmask_core::cast::{Hit, Hits, Ray};
use pairmask_core::{Aabb, BoxClass, Sphere};

use crate::stress_scenes::Rng;

/// Every finite f32 is a whole number of 2^-149.
const UNIT: i32 = 149;

fn exact(x: f32) -> BigInt {
    let bits = x.to_bits();
    let (exponent, fraction) = ((bits >> 23 & 0xff) as i32, bits & 0x7f_ffff);
    assert!(exponent < 255, "finite: {x}");
    let magnitude = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (exponent - 150 + UNIT) as u32,
    };
    if x.is_sign_negative() { -magnitude } else { magnitude }
}

/// A number over one above 0.
#[derive(Clone, Debug)]
pub struct Fraction {
    number: BigInt,
    over: BigInt,
}

impl Fraction {
    fn of(number: BigInt, over: BigInt) -> Self {
        if over.sign() == Sign::Minus {
            Self { number: -number, over: -over }
        } else {
            Self { number, over }
        }
    }

    fn whole(number: BigInt) -> Self {
        Self { number, over: BigInt::from(1) }
    }

    fn compare(&self, other: &Self) -> Ordering {
        (&self.number * &other.over).cmp(&(&other.number * &self.over))
    }
}

/// What a distance is compared by: itself for a ray, its square for a sphere.
#[derive(Clone, Debug)]
pub struct Exact {
    pub index: u32,
    distance: Fraction,
    is_square: bool,
}

fn is_valid(b: &Aabb) -> bool {
    b.class() == BoxClass::Valid
}

/// The t of a point on the way of a ray, as a fraction of plain numbers.
fn ray_distance(ray: &Ray, b: &Aabb) -> Option<Fraction> {
    let numbers = ray.origin.iter().chain(&ray.direction).chain(&ray.half_extents);
    let is_wrong = numbers.copied().any(|x: f32| !x.is_finite())
        || ray.half_extents.iter().any(|h| *h < 0.0)
        || ray.most.is_nan()
        || ray.most < 0.0;
    if is_wrong || !is_valid(b) {
        return None;
    }
    let mut enter = Fraction::whole(BigInt::from(0));
    let mut leaves = Vec::new();
    if ray.most.is_finite() {
        leaves.push(Fraction::of(exact(ray.most), BigInt::from(1) << UNIT as u32));
    }
    for axis in 0..3 {
        let (o, d, h) = (ray.origin[axis], ray.direction[axis], ray.half_extents[axis]);
        let (o, h) = (exact(o), exact(h));
        let (min, max) = (b.min[axis], b.max[axis]);
        if min == f32::INFINITY || max == f32::NEG_INFINITY {
            return None;
        }
        let low = min.is_finite().then(|| exact(min) - &h - &o);
        let high = max.is_finite().then(|| exact(max) + &h - &o);
        if d == 0.0 {
            if low.is_some_and(|low| low.sign() == Sign::Plus)
                || high.is_some_and(|high| high.sign() == Sign::Minus)
            {
                return None;
            }
            continue;
        }
        let (near, far) = if d > 0.0 { (low, high) } else { (high, low) };
        if let Some(near) = near {
            let near = Fraction::of(near, exact(d));
            if near.compare(&enter).is_gt() {
                enter = near;
            }
        }
        leaves.extend(far.map(|far| Fraction::of(far, exact(d))));
    }
    leaves.iter().all(|leave| enter.compare(leave).is_le()).then_some(enter)
}

/// The square of the distance of a box from a sphere's center, in squares of the unit.
fn sphere_distance(sphere: &Sphere, b: &Aabb) -> Option<Fraction> {
    if sphere.class() != BoxClass::Valid || !is_valid(b) {
        return None;
    }
    let mut square = BigInt::from(0);
    for axis in 0..3 {
        let (center, min, max) = (sphere.center[axis], b.min[axis], b.max[axis]);
        if min == f32::INFINITY || max == f32::NEG_INFINITY {
            return None;
        }
        let face = if min > center { min } else { max };
        if min > center || max < center {
            let gap = exact(face) - exact(center);
            square += &gap * &gap;
        }
    }
    let is_within = sphere.radius == f32::INFINITY || {
        let radius = exact(sphere.radius);
        square <= &radius * &radius
    };
    is_within.then(|| Fraction::whole(square))
}

fn in_order(mut all: Vec<Exact>) -> Vec<Exact> {
    all.sort_by(|a, b| a.distance.compare(&b.distance).then(a.index.cmp(&b.index)));
    all
}

/// All boxes that a ray hits, in order.
pub fn hit_by(ray: &Ray, boxes: &[Aabb]) -> Vec<Exact> {
    let of = |(index, b)| {
        let distance = ray_distance(ray, b)?;
        Some(Exact { index, distance, is_square: false })
    };
    in_order((0..).zip(boxes).filter_map(of).collect())
}

/// All boxes that a sphere touches, in order.
pub fn touched_by(sphere: &Sphere, boxes: &[Aabb]) -> Vec<Exact> {
    let of = |(index, b)| {
        let distance = sphere_distance(sphere, b)?;
        Some(Exact { index, distance, is_square: true })
    };
    in_order((0..).zip(boxes).filter_map(of).collect())
}

impl Exact {
    /// Whether a reported distance is at most a step of f32 from the exact one.
    fn is_near(&self, reported: f32) -> bool {
        let of = |x: f32| {
            let x = exact(x);
            if self.is_square {
                Fraction::whole(&x * &x)
            } else {
                Fraction::of(x, BigInt::from(1) << UNIT as u32)
            }
        };
        let is_above = |x: f32| !x.is_finite() || of(x).compare(&self.distance).is_ge();
        let below = reported.next_down().max(0.0);
        let is_below = || below == 0.0 || of(below).compare(&self.distance).is_le();
        reported >= 0.0 && is_above(reported.next_up()) && is_below()
    }
}

/// Says what is wrong with the hits of one question, which must be of the query with this number.
pub fn check(query: u32, hits: &[Hit], expected: &[Exact], asked: Hits) -> Result<(), String> {
    let most = match asked {
        Hits::Any if expected.is_empty() => 0,
        Hits::Any => {
            let any = Hit { query, index: Hit::ANY, distance: 0.0 };
            return if hits == [any] { Ok(()) } else { Err(format!("any: {hits:?}")) };
        }
        Hits::All => expected.len(),
        Hits::Closest(most) => expected.len().min(most as usize),
    };
    let expected = &expected[..most];
    let found: Vec<u32> = hits.iter().map(|hit| hit.index).collect();
    let right: Vec<u32> = expected.iter().map(|exact| exact.index).collect();
    if found != right {
        return Err(format!("{asked:?}: found {found:?}, exactly {right:?}"));
    }
    for (hit, exact) in hits.iter().zip(expected) {
        if hit.query != query || !exact.is_near(hit.distance) {
            return Err(format!("query {query}: {hit:?} for {exact:?}"));
        }
    }
    Ok(())
}

/// Hits of each of so many queries, which must come in their order.
pub fn by_query(hits: &[Hit], queries: usize) -> Vec<&[Hit]> {
    let mut rest = hits;
    let by_query = (0..queries as u32).map(|query| {
        let end = rest.iter().position(|hit| hit.query != query).unwrap_or(rest.len());
        let (own, others) = rest.split_at(end);
        rest = others;
        own
    });
    let by_query = by_query.collect();
    assert!(rest.is_empty(), "out of order: {:?}", rest.first());
    by_query
}

/// Where coordinates are drawn from.
#[derive(Clone, Copy, Debug)]
pub enum Numbers {
    /// Quarters: many faces and distances are the same.
    Quarters,
    /// Quarters and all that is odd: infinite, NaN, huge, subnormal.
    Odd,
    /// Any magnitude.
    Wild,
    /// Ordinary fractions.
    Fractions,
}

impl Numbers {
    pub const ALL: [Self; 4] = [Self::Quarters, Self::Odd, Self::Wild, Self::Fractions];

    pub fn draw(self, rng: &mut Rng) -> f32 {
        let quarter = (rng.below(33) as f32 - 16.0) / 4.0;
        match self {
            Self::Odd if rng.below(12) == 0 => {
                let odd = [
                    f32::NAN,
                    f32::INFINITY,
                    f32::NEG_INFINITY,
                    f32::MAX,
                    f32::MIN,
                    f32::MIN_POSITIVE,
                    1e-45,
                    -1e-45,
                    -0.0,
                    1e37,
                ];
                odd[rng.below(odd.len() as u32) as usize]
            }
            Self::Quarters | Self::Odd => quarter,
            Self::Wild => {
                let x = f32::from_bits(rng.below(u32::MAX));
                if x.is_nan() { quarter } else { x }
            }
            Self::Fractions => rng.point()[0] * 8.0 - 4.0,
        }
    }

    fn point(self, rng: &mut Rng) -> [f32; 3] {
        std::array::from_fn(|_| self.draw(rng))
    }

    /// A box, which may be a point, empty or invalid.
    pub fn some_box(self, rng: &mut Rng) -> Aabb {
        let (a, b) = (self.point(rng), self.point(rng));
        if rng.below(16) == 0 {
            return Aabb::new(a, b);
        }
        // Of a NaN and a number both are the number, which then is a flat box.
        let min = std::array::from_fn(|axis| a[axis].min(b[axis]));
        let max: [f32; 3] = std::array::from_fn(|axis| a[axis].max(b[axis]));
        Aabb::new(min, if rng.below(4) == 0 { min } else { max })
    }

    pub fn ray(self, rng: &mut Rng) -> Ray {
        let (origin, mut direction) = (self.point(rng), self.point(rng));
        for d in &mut direction {
            if rng.below(3) == 0 {
                *d = [0.0, -0.0, 1.0, -1.0][rng.below(4) as usize];
            }
        }
        let most = [f32::INFINITY, f32::INFINITY, 0.0, 1.0, 2.5, -0.0][rng.below(6) as usize];
        let most = if rng.below(8) == 0 { self.draw(rng) } else { most };
        let half = if rng.below(3) == 0 { self.point(rng).map(f32::abs) } else { [0.0; 3] };
        Ray::new(origin, direction).up_to(most).with_half_extents(half)
    }

    pub fn sphere(self, rng: &mut Rng) -> Sphere {
        let center = self.point(rng);
        let radius = match rng.below(4) {
            0 => f32::INFINITY,
            1 => 0.0,
            _ => self.draw(rng),
        };
        Sphere::new(center, if rng.below(8) == 0 { radius } else { radius.abs() })
    }
}

/// A ray in a scene of some extent, of quarters.
pub fn a_ray(rng: &mut Rng, extent: f32) -> Ray {
    let mut point = || rng.point().map(|x| (x * 4.0 * extent).floor() / 4.0);
    let (origin, to) = (point(), point());
    let ray = match rng.below(4) {
        0 => Ray::between(origin, to),
        1 => Ray::new(origin, [[1.0, 0.0, 0.0], [0.0, -0.5, -0.0]][rng.below(2) as usize]),
        2 => Ray::new(origin, to.map(|x| x - extent / 2.0)).up_to(2.0),
        _ => Ray::new(origin, to.map(|x| extent / 2.0 - x)),
    };
    let half = [0.0, 0.0, 0.25, 1.0][rng.below(4) as usize];
    ray.with_half_extents([half, 0.0, half])
}

/// A sphere in such a scene.
pub fn a_sphere(rng: &mut Rng, extent: f32) -> Sphere {
    let center = rng.point().map(|x| (x * 4.0 * extent).floor() / 4.0);
    Sphere::new(center, [f32::INFINITY, 1.0, 2.5, extent / 3.0][rng.below(4) as usize])
}

/// One of the ways to ask.
pub fn some_hits(rng: &mut Rng) -> Hits {
    match rng.below(8) {
        0 | 1 => Hits::All,
        2 => Hits::Any,
        3 => Hits::Closest(40),
        _ => Hits::Closest(rng.below(10)),
    }
}
