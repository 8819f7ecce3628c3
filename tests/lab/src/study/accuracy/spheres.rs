//! Bounding spheres in place of the scene's boxes.

use std::hint::black_box;
use std::time::Instant;

use pairmask::ServedBy;
use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{EngineId, HeapReply};
use pairmask_core::mask::MaskView;
use pairmask_core::sphere::{SPHERE_BYTES, Sphere};
use pairmask_core::{Aabb, BoxClass, BoxCount};
use pairmaskd::timed_client::TimedError;
use rayon::prelude::*;

use super::contender::{Answer, Contender, FrameFigures};
use super::mode::Fit;
use super::truth::{self, Pair, outward};
use crate::study::spheres::oracle;

/// Spheres of the boxes, culled in this process.
pub struct SphereClient {
    fit: Fit,
    options: CullOptions,
    engines: SphereEngines,
    spheres: Vec<Sphere>,
    reply: HeapReply,
}

impl SphereClient {
    /// A client with spheres of a fit.
    pub fn new(fit: Fit, options: CullOptions) -> Self {
        let (engines, spheres, reply) = Default::default();
        Self { fit, options, engines, spheres, reply }
    }
}

impl Contender for SphereClient {
    /// The fill is the time to make spheres of the boxes.
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        let start = Instant::now();
        self.spheres.clear();
        self.spheres.extend(boxes.iter().map(|b| sphere(b, self.fit)));
        let filled = Instant::now();
        let answer = self.engines.cull(&self.spheres, &self.options, &mut self.reply)?;
        let answered = Instant::now();
        self.options.last_pairs = Some(answer.report.pair_count);
        let n = BoxCount::new(boxes.len() as u32);
        let mask = MaskView::new(n, &answer.report.shape, self.reply.words())?;
        let (mut decoded, mut indices) = (0, 0);
        mask.for_each(|a, b| {
            decoded += 1;
            indices ^= a ^ b;
        });
        black_box(indices);
        let decode = answered.elapsed();
        let counted = answer.report.pair_count;
        if counted != decoded {
            return Err(TimedError::Miscounted { counted, decoded });
        }
        let pairs = wants_pairs.then(|| {
            let mut pairs: Vec<Pair> = mask.pairs().collect();
            pairs.sort_unstable();
            pairs
        });
        let figures = FrameFigures {
            backend: ServedBy::InProcess.as_str(),
            engine: answer.engine.into(),
            was_asked: true,
            fill: filled - start,
            round_trip: answered - filled,
            decode,
            stages: answer.times,
            box_bytes: (self.spheres.len() * SPHERE_BYTES) as u64,
            mask_bytes: answer.report.shape.mask_bytes(),
        };
        Ok(Answer { figures, pairs })
    }

    fn truth(&self, _: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        pairs(&self.spheres, engine)
    }

    fn stands_for_boxes(&self) -> bool {
        true
    }
}

/// The sphere of a box. Around: it holds the box. Within: the box holds it. Empty and invalid boxes
/// become spheres of the same class. The sphere around a box with an infinite face is all of space.
pub fn sphere(b: &Aabb, fit: Fit) -> Sphere {
    match b.class() {
        BoxClass::Empty => return Sphere::EMPTY,
        BoxClass::Invalid => return Sphere::new([f32::NAN; 3], 0.0),
        BoxClass::Solid => {}
    }
    let center: [f32; 3] = std::array::from_fn(|axis| {
        let (min, max) = (b.min[axis], b.max[axis]);
        let middle = min.midpoint(max);
        // A finite point within the box, also if faces are infinite.
        if middle.is_finite() { middle } else { 0f32.clamp(min, max).clamp(f32::MIN, f32::MAX) }
    });
    // f64 holds the difference of two f32 to 2^−53 of it, far below a step of f32.
    let reaches = (0..3).map(|axis| {
        let [min, max, middle] = [b.min[axis], b.max[axis], center[axis]].map(f64::from);
        [middle - min, max - middle]
    });
    let radius = match fit {
        Fit::Circumscribed => {
            let corner = reaches.map(|[low, high]| low.max(high).powi(2)).sum::<f64>();
            outward(corner.sqrt(), true)
        }
        Fit::Inscribed => {
            let nearest = reaches.map(|[low, high]| low.min(high)).fold(f64::INFINITY, f64::min);
            outward(nearest, false).max(0.0)
        }
    };
    Sphere::new(center, radius)
}

/// The exact pairs of spheres: each compared with each; in a large scene, candidates are the pairs of
/// boxes that are wider by a step on each side.
fn pairs(spheres: &[Sphere], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
    if spheres.len() <= truth::NAIVE_LIMIT {
        return Ok(oracle::pairs(spheres));
    }
    let wide = |s: &Sphere| match s.class() {
        BoxClass::Solid => Aabb {
            min: s.center.map(|x| outward(f64::from(x) - f64::from(s.radius), false)),
            max: s.center.map(|x| outward(f64::from(x) + f64::from(s.radius), true)),
        },
        BoxClass::Empty | BoxClass::Invalid => Aabb::EMPTY,
    };
    let candidates = truth::pairs(&spheres.iter().map(wide).collect::<Vec<_>>(), engine)?;
    let overlap = |&(a, b): &Pair| oracle::overlap(&spheres[a as usize], &spheres[b as usize]);
    Ok(candidates.into_par_iter().filter(overlap).collect())
}

#[cfg(test)]
mod tests {
    use pairmaskd::scene::{Random, Scene, SceneName};

    use super::*;

    #[test]
    fn spheres_around_hold_the_box_and_spheres_within_are_held() {
        let scene = Scene::new(SceneName::Mixed, 2_000, 3);
        for b in scene.boxes() {
            let (around, within) = (sphere(b, Fit::Circumscribed), sphere(b, Fit::Inscribed));
            for corner in 0..8 {
                let corner: [f32; 3] = std::array::from_fn(|axis| {
                    if corner >> axis & 1 == 0 { b.min[axis] } else { b.max[axis] }
                });
                assert!(oracle::overlap(&around, &Sphere::new(corner, 0.0)), "{b:?} {around:?}");
            }
            for axis in 0..3 {
                let [c, r] = [within.center[axis], within.radius].map(f64::from);
                let inside = f64::from(b.min[axis]) <= c - r && c + r <= f64::from(b.max[axis]);
                assert!(inside && r > 0.0, "{b:?} {within:?}");
            }
        }
    }

    #[test]
    fn boxes_that_are_no_solid_finite_ones_have_spheres_of_their_kind() {
        for fit in [Fit::Circumscribed, Fit::Inscribed] {
            assert_eq!(sphere(&Aabb::EMPTY, fit).class(), BoxClass::Empty);
            let nan = Aabb { min: [f32::NAN; 3], max: [1.0; 3] };
            assert_eq!(sphere(&nan, fit).class(), BoxClass::Invalid);
            let half = Aabb { min: [f32::NEG_INFINITY, 1.0, 1.0], max: [-3.0, 2.0, f32::INFINITY] };
            let s = sphere(&half, fit);
            assert_eq!(s.class(), BoxClass::Solid, "{s:?}");
            assert_eq!(s.radius == f32::INFINITY, fit == Fit::Circumscribed, "{s:?}");
        }
    }

    #[test]
    fn large_scenes_have_the_pairs_that_two_loops_find() -> Result<(), TimedError> {
        let mut random = Random::new(7);
        let n = truth::NAIVE_LIMIT + 1;
        let mut one = || Sphere::new([(); 3].map(|()| 16.0 * random.unit()), random.unit());
        let mut spheres: Vec<Sphere> = (0..n).map(|_| one()).collect();
        spheres[7] = Sphere::EMPTY;
        spheres[8].radius = f32::INFINITY;
        spheres[9].center[1] = f32::NAN;
        assert_eq!(
            pairs(&spheres, pairmask_core::EngineName::CpuSap.into())?,
            oracle::pairs(&spheres)
        );
        Ok(())
    }

    #[test]
    fn masks_have_the_spheres_pairs() -> Result<(), TimedError> {
        let scene = Scene::new(SceneName::Pile, 700, 1);
        for fit in [Fit::Circumscribed, Fit::Inscribed] {
            let mut client = SphereClient::new(fit, CullOptions::default());
            let answer = client.frame(scene.boxes(), true)?;
            let truth = client.truth(scene.boxes(), answer.figures.engine)?;
            assert_eq!(answer.pairs.as_ref(), Some(&truth));
            let of_boxes = truth::pairs(scene.boxes(), answer.figures.engine)?;
            let found = truth::Difference::between(&truth, &of_boxes);
            assert_eq!(found.missed == 0, fit == Fit::Circumscribed, "{found:?}");
            assert_eq!(found.extra == 0, fit == Fit::Inscribed, "{found:?}");
        }
        Ok(())
    }
}
