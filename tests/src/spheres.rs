//! Scenes of spheres, their right answers, and checks of sessions against them.

use pairmask::{PairMask, Session};
use pairmask_core::engine::{Census, NAMED_INVALID, SkipMeter};
use pairmask_core::oracle::check::{Mismatch, check_reply};
use pairmask_core::oracle::{Pair, Truth};
use pairmask_core::{Encoding, Sphere};
use pairmask_lab::study::spheres::{families, oracle};
use pairmaskd::scene::Random;

use crate::frames::{Frames, report_of};

/// `n` spheres that are hard to decide: pairs that touch or miss touching by one ulp, all
/// magnitudes, and all classes.
pub fn hard_scene(n: usize, seed: u64) -> Vec<Sphere> {
    let mut random = Random::new(seed ^ n as u64);
    let mut spheres = Vec::with_capacity(n + 1);
    while spheres.len() < n {
        let family = families::ALL[random.below(families::ALL.len() as u64) as usize];
        let (a, b) = (family.make)(&mut random);
        spheres.extend([a, b]);
    }
    spheres.truncate(n);
    for sphere in &mut spheres {
        let axis = random.below(3) as usize;
        match random.below(20) {
            0 => *sphere = Sphere::EMPTY,
            1 => sphere.radius = f32::NEG_INFINITY,
            2 => sphere.radius = f32::NAN,
            3 => sphere.center[axis] = f32::NAN,
            4 => sphere.center[axis] = f32::INFINITY,
            5 => sphere.radius = f32::INFINITY,
            6 => sphere.radius = -0.0,
            _ => {}
        }
    }
    spheres
}

/// `n` spheres anywhere in a cube, each of which meets a few: numbers at random, so that next to none touch.
pub fn plain_scene(n: usize, seed: u64) -> Vec<Sphere> {
    let mut random = Random::new(seed);
    let side = (n as f32).cbrt();
    let mut sphere = || {
        let center = std::array::from_fn(|_| random.range(-side, side));
        Sphere::new(center, random.range(0.1, 1.0))
    };
    (0..n).map(|_| sphere()).collect()
}

/// `count` pairs of each family of pairs that are hard to decide, each family from the same seed.
pub fn hard_pairs(count: usize, seed: u64) -> Vec<(Sphere, Sphere)> {
    let of_family = |family: &families::Family| {
        let mut random = Random::new(seed);
        (0..count).map(|_| (family.make)(&mut random)).collect::<Vec<_>>()
    };
    families::ALL.iter().flat_map(of_family).collect()
}

/// The answer for `spheres`, by exact rational arithmetic: some microseconds a pair.
pub fn truth(spheres: &[Sphere]) -> Truth {
    Truth { pairs: oracle::pairs(spheres), census: census(spheres) }
}

fn census(spheres: &[Sphere]) -> Census {
    let is_invalid = |s: &Sphere| !s.center.iter().all(|x| x.is_finite()) || s.radius.is_nan();
    let invalid: Vec<u32> =
        (0u32..).zip(spheres).filter(|(_, s)| is_invalid(s)).map(|(i, _)| i).collect();
    let empty = spheres.iter().filter(|s| !is_invalid(s) && s.radius < 0.0).count();
    let mut first_invalid = [0; NAMED_INVALID];
    for (slot, index) in first_invalid.iter_mut().zip(&invalid) {
        *slot = *index;
    }
    Census { invalid: invalid.len() as u32, empty: empty as u32, first_invalid }
}

/// `n` spheres of whole numbers in a cube of `side`, and their pairs in whole numbers: for scenes
/// that are too large for [`truth`]. Many touch.
pub fn whole_scene(n: usize, side: u64, seed: u64) -> (Vec<Sphere>, Truth) {
    let mut random = Random::new(seed);
    let whole: Vec<[i64; 4]> = (0..n)
        .map(|_| {
            let [x, y, z] = std::array::from_fn(|_| random.below(side) as i64);
            [x, y, z, random.below(4) as i64]
        })
        .collect();
    let overlap = |p: &[i64; 4], q: &[i64; 4]| {
        let square = |x: i64| x * x;
        (0..3).map(|axis| square(p[axis] - q[axis])).sum::<i64>() <= square(p[3] + q[3])
    };
    let mut pairs: Vec<Pair> = Vec::new();
    for (a, p) in whole.iter().enumerate() {
        let later = whole.iter().enumerate().skip(a + 1).filter(|(_, q)| overlap(p, q));
        pairs.extend(later.map(|(b, _)| [a as u32, b as u32]));
    }
    let spheres = whole.iter().map(|s| Sphere::from(s.map(|x| x as f32))).collect();
    (spheres, Truth { pairs, census: Census::default() })
}

pub fn cull(session: &mut Session, spheres: &[Sphere]) -> PairMask {
    session.ask_spheres(spheres).wait().expect("a frame is answered")
}

pub fn check_mask(mask: &PairMask, encoding: Encoding, truth: &Truth) -> Result<(), Mismatch> {
    let mut report = report_of(mask);
    if report.skipped.is_repeat() {
        // The frame was answered again: the meter says so of all its pairs, and no engine counted.
        let (skipped, expected) = (report.skipped, SkipMeter::of_repeat(mask.n(), &report.skipped));
        if skipped != expected {
            let (what, got) = ("pairs of a repeat", skipped.pairs);
            return Err(Mismatch::Skip { what, got, possible: expected.pairs..=expected.pairs });
        }
        let boxes = u64::from(truth.census.empty) + u64::from(truth.census.invalid);
        report.skipped =
            SkipMeter { boxes, zero_words: skipped.zero_words, ..SkipMeter::default() };
    }
    check_reply(mask.reply_words(), &report, mask.n().get(), encoding, truth)
}
