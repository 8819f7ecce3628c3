//! Rays: the slab test (Kay and Kajiya 1986), rounded outward for bounds and exact for boxes.

use std::cmp::Ordering;
use std::ops::{Mul, Sub};

use super::Ray;
use super::exact::{ERROR, sign_of_sum};
use super::node::{FAN_OUT, Keys, MISSED, Node, key};
use super::probe::{Probe, ROUNDING, limit_above};
use crate::aabb::Aabb;
use crate::floats::two_sum;

/// Largest origins and half extents for bounds in f32: what is subtracted from them does not overflow.
const FARTHEST: f32 = 1e30;
/// Magnitudes of directions for bounds in f32: one over them is a normal number.
const DIRECTIONS: std::ops::RangeInclusive<f32> = 1e-37..=1e37;

/// What bounds are computed in.
pub(super) trait Real: Copy + PartialOrd + Sub<Output = Self> + Mul<Output = Self> {
    const ZERO: Self;
    const INFINITY: Self;

    fn of(x: f32) -> Self;
    fn one_over(x: f32) -> Self;
    /// A sum that is not below the exact one, and is `a` where `b` is 0.
    fn sum_above(a: f32, b: f32) -> Self;
    fn negated(self) -> Self;
    /// In f32, and not above it.
    fn lowered(self) -> f32;
    /// Whether a ray that enters and leaves there, but for rounding, may hit.
    fn is_met(enter: Self, leave: Self) -> bool;
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const INFINITY: Self = Self::INFINITY;

    #[inline(always)]
    fn of(x: f32) -> Self {
        x
    }

    fn one_over(x: f32) -> Self {
        1.0 / x
    }

    fn sum_above(a: f32, b: f32) -> Self {
        if b == 0.0 { a } else { (a + b).next_up() }
    }

    fn negated(self) -> Self {
        -self
    }

    #[inline(always)]
    fn lowered(self) -> f32 {
        self * (1.0 - ROUNDING)
    }

    // Subnormal products are off by less than the smallest normal number.
    #[inline(always)]
    fn is_met(enter: Self, leave: Self) -> bool {
        enter <= leave * (1.0 + ROUNDING) + Self::MIN_POSITIVE
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const INFINITY: Self = Self::INFINITY;

    #[inline(always)]
    fn of(x: f32) -> Self {
        Self::from(x)
    }

    fn one_over(x: f32) -> Self {
        1.0 / Self::from(x)
    }

    fn sum_above(a: f32, b: f32) -> Self {
        let [a, b] = [a, b].map(Self::from);
        if b == 0.0 { a } else { (a + b).next_up() }
    }

    fn negated(self) -> Self {
        -self
    }

    // Beyond f32, a bound is the largest finite number: boxes there are all decided exactly.
    #[inline(always)]
    fn lowered(self) -> f32 {
        (self.min(f32::MAX.into()) as f32).lowered().max(0.0)
    }

    // Nothing overflows: infinite is what is at infinity.
    #[inline(always)]
    fn is_met(enter: Self, leave: Self) -> bool {
        enter < Self::INFINITY && enter <= leave + leave.abs() * Self::from(ROUNDING)
    }
}

/// A valid ray.
#[derive(Clone, Copy)]
pub(super) struct RayProbe {
    ray: Ray,
    /// The largest t that makes a difference.
    most: f32,
    bounds: Bounds,
}

/// By what boxes are left out before they are measured.
#[derive(Clone, Copy)]
enum Bounds {
    None,
    Usual(Slabs<f32>),
    /// For extreme numbers.
    Extreme(Slabs<f64>),
}

/// Bounds of where a ray enters and leaves boxes.
#[derive(Clone, Copy)]
struct Slabs<F> {
    /// What faces that the ray enters, and leaves, by are counted from.
    near: [F; 3],
    far: [F; 3],
    one_over: [F; 3],
    /// Whether it enters by the maxes.
    is_reversed: [bool; 3],
}

fn is_valid(Ray { origin, direction, most, half_extents }: &Ray) -> bool {
    origin.iter().chain(direction).all(|x| x.is_finite())
        && half_extents.iter().all(|x| x.is_finite() && *x >= 0.0)
        && *most >= 0.0
}

/// Whether bounds of a valid ray are to be in f64.
fn is_extreme(Ray { origin, direction, half_extents, .. }: &Ray) -> bool {
    let is_usual = |x: &f32| *x == 0.0 || DIRECTIONS.contains(&x.abs());
    let is_near = |x: &f32| x.abs() <= FARTHEST;
    !(direction.iter().all(is_usual) && origin.iter().chain(half_extents).all(is_near))
}

impl<F: Real> Slabs<F> {
    fn of(Ray { origin, direction, half_extents, .. }: &Ray) -> Self {
        let mut slabs = Self {
            near: [F::ZERO; 3],
            far: [F::ZERO; 3],
            one_over: [F::INFINITY; 3],
            is_reversed: [false; 3],
        };
        for axis in 0..3 {
            let (o, h, d) = (origin[axis], half_extents[axis], direction[axis]);
            // Mins are less the half extents, and so counted from an origin with them; maxes the other way.
            let (of_mins, of_maxes) = (F::sum_above(o, h), F::sum_above(-o, h).negated());
            slabs.is_reversed[axis] = d < 0.0;
            (slabs.near[axis], slabs.far[axis]) =
                if d < 0.0 { (of_maxes, of_mins) } else { (of_mins, of_maxes) };
            if d != 0.0 {
                slabs.one_over[axis] = F::one_over(d);
            }
        }
        slabs
    }

    /// The keys of 16 boxes. What is no number, of a face at the origin and a component 0 of the direction, bounds nothing.
    #[inline(always)]
    fn keys(&self, boxes: &Node, limit: f32, keys: &mut Keys) {
        let mut enter = [F::ZERO; FAN_OUT];
        let mut leave = [F::of(limit); FAN_OUT];
        for axis in 0..3 {
            let (mins, maxes) = (&boxes.min[axis], &boxes.max[axis]);
            let (nears, fars) = if self.is_reversed[axis] { (maxes, mins) } else { (mins, maxes) };
            let (near, far, one_over) = (self.near[axis], self.far[axis], self.one_over[axis]);
            for lane in 0..FAN_OUT {
                let at = (F::of(nears[lane]) - near) * one_over;
                enter[lane] = if at > enter[lane] { at } else { enter[lane] };
                let at = (F::of(fars[lane]) - far) * one_over;
                leave[lane] = if at < leave[lane] { at } else { leave[lane] };
            }
        }
        for lane in 0..FAN_OUT {
            let is_met = F::is_met(enter[lane], leave[lane]);
            keys[lane] = if is_met { key(enter[lane].lowered(), lane) } else { MISSED };
        }
    }
}

impl RayProbe {
    /// One that knows no bounds, and measures boxes; `None` for an invalid ray, which hits nothing.
    pub fn without_bounds(ray: &Ray) -> Option<Self> {
        is_valid(ray).then(|| Self {
            ray: *ray,
            // One that does not move is where it is at once. Never -0, whose bits do not sort.
            most: if ray.direction.iter().all(|d| *d == 0.0) { 0.0 } else { ray.most + 0.0 },
            bounds: Bounds::None,
        })
    }

    /// `None` for an invalid ray, which hits nothing.
    pub fn new(ray: &Ray) -> Option<Self> {
        let bounds = if is_extreme(ray) {
            Bounds::Extreme(Slabs::of(ray))
        } else {
            Bounds::Usual(Slabs::of(ray))
        };
        Some(Self { bounds, ..Self::without_bounds(ray)? })
    }

    /// Where the ray enters a slab, and where it leaves it.
    fn faces(&self, axis: usize, b: &Aabb) -> [Face; 2] {
        let Ray { origin, direction, half_extents, .. } = self.ray;
        let [origin, half, d] = [origin, half_extents, direction].map(|of| f64::from(of[axis]));
        let min = Face { at: b.min[axis].into(), half: -half, origin, direction: d };
        let max = Face { at: b.max[axis].into(), half, origin, direction: d };
        if d < 0.0 { [max, min] } else { [min, max] }
    }

    /// Whether a ray that enters a box as late as it leaves it, as far as f64 say, does so.
    #[cold]
    fn hits_exactly(&self, b: &Aabb) -> bool {
        let moving = || (0..3).filter(|axis| self.ray.direction[*axis] != 0.0);
        let end = Fraction { parts: [self.ray.most.into(), 0.0, 0.0], over: 1.0 };
        moving().filter_map(|axis| self.faces(axis, b)[0].fraction()).all(|enter| {
            let leaves = moving().filter_map(|axis| self.faces(axis, b)[1].fraction());
            let end = self.ray.most.is_finite().then_some(end);
            leaves.chain(end).all(|leave| enter.compare(&leave).is_le())
        })
    }

    /// The exact distance of a box that is hit.
    fn entry(&self, b: &Aabb) -> Fraction {
        let moving = (0..3).filter(|axis| self.ray.direction[*axis] != 0.0);
        let enters = moving.filter_map(|axis| self.faces(axis, b)[0].fraction());
        enters.fold(Fraction { parts: [0.0; 3], over: 1.0 }, |latest, enter| {
            if enter.compare(&latest).is_gt() { enter } else { latest }
        })
    }
}

/// A face of a box, and what a ray on its axis has to do with it.
struct Face {
    at: f64,
    half: f64,
    origin: f64,
    direction: f64,
}

impl Face {
    /// How far it is from the origin on its axis: rounded, and of the right sign.
    #[inline(always)]
    fn offset(&self) -> f64 {
        if !self.at.is_finite() {
            return self.at;
        }
        let (moved, rest) = two_sum(self.at, self.half);
        let (offset, more) = two_sum(moved, -self.origin);
        offset + (more + rest)
    }

    /// Where the ray meets it, exactly; `None` at infinity.
    fn fraction(&self) -> Option<Fraction> {
        let sign = self.direction.signum();
        self.at.is_finite().then(|| Fraction {
            parts: [sign * self.at, sign * self.half, -sign * self.origin],
            over: self.direction.abs(),
        })
    }
}

/// A sum of three f32 over one above 0.
#[derive(Clone, Copy)]
struct Fraction {
    parts: [f64; 3],
    over: f64,
}

impl Fraction {
    fn compare(&self, other: &Self) -> Ordering {
        // Products of two f32 are f64.
        let own = self.parts.iter().map(|part| part * other.over);
        let others = other.parts.iter().map(|part| -part * self.over);
        sign_of_sum(own.chain(others))
    }
}

impl Probe for RayProbe {
    #[inline(always)]
    fn keys(&self, boxes: &Node, limit: f32, keys: &mut Keys) {
        match &self.bounds {
            Bounds::None => *keys = std::array::from_fn(|lane| key(0.0, lane)),
            Bounds::Usual(slabs) => slabs.keys(boxes, limit, keys),
            Bounds::Extreme(slabs) => slabs.keys(boxes, limit, keys),
        }
    }

    fn most(&self) -> f32 {
        self.most
    }

    fn limit_of(&self, distance: f64) -> f32 {
        limit_above(distance)
    }

    fn measure(&self, b: &Aabb) -> Option<f64> {
        let (mut enter, mut leave) = (0.0, f64::from(self.ray.most));
        for axis in 0..3 {
            let [near, far] = self.faces(axis, b).map(|face| face.offset());
            let d = f64::from(self.ray.direction[axis]);
            if d == 0.0 {
                if near > 0.0 || far < 0.0 {
                    return None;
                }
                continue;
            }
            enter = f64::max(enter, near / d);
            leave = f64::min(leave, far / d);
        }
        let is_hit = if enter == f64::INFINITY || enter > leave * (1.0 + ERROR) {
            false
        } else {
            enter < leave * (1.0 - ERROR) || leave >= 0.0 && self.hits_exactly(b)
        };
        is_hit.then_some(enter)
    }

    fn compare(&self, a: &Aabb, b: &Aabb) -> Ordering {
        self.entry(a).compare(&self.entry(b))
    }

    fn reported(&self, distance: f64) -> f32 {
        distance as f32
    }
}
