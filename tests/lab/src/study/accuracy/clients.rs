//! Who answers the frames of a row: boxes through a session, a world in f64 through a session, or spheres in this
//! process.

use std::time::Instant;

use glam::{DVec3, Vec3};
use pairmask::{Backend, Error, PairMask, Session};
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::{Faces, truth_of_faces};
use pairmask_core::sphere::Sphere;
use pairmask_core::{Aabb, Bounds, BoxClass};
use pairmaskd::timed_client::{Decoding, TimedClient, TimedError, TimedFrame};
use rayon::prelude::*;

use super::mode::{StudyMode, World};
use super::truth::{self, Pair, outward};
use crate::study::spheres::oracle;

/// A way to answer the frames of a scene, and its right answers.
pub trait Client {
    /// Answers a frame of boxes. The answer has `pairs` if `wants_pairs`.
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError>;

    /// The right pairs of the last frame, sorted, found in another way than by `engine`.
    fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError>;

    fn stands_for_boxes(&self) -> bool {
        false
    }
}

#[derive(Clone, Debug)]
pub struct Answer {
    pub frame: TimedFrame,
    pub pairs: Option<Vec<Pair>>,
}

impl Answer {
    fn of(mask: &PairMask, times: [Instant; 3], wants_pairs: bool) -> Result<Self, TimedError> {
        let frame = TimedFrame::of(mask, &Decoding::Serial, true, times)?;
        Ok(Self { frame, pairs: wants_pairs.then(|| sorted(mask)) })
    }
}

/// Spheres are culled in this process, by the engine of `options`; all others in the session.
pub fn client(
    mode: StudyMode,
    options: &CullOptions,
    session: Session,
    boxes: &[Aabb],
) -> Result<Box<dyn Client>, TimedError> {
    Ok(match mode {
        StudyMode::Sent(precision) => {
            Box::new(BoxClient(TimedClient::new(session, precision, boxes)))
        }
        StudyMode::World(world) => Box::new(WorldClient::new(session, world, boxes)),
        StudyMode::Spheres => {
            let mut own = Session::builder().backend(Backend::InProcess).answer_repeats(false);
            if let Some(threads) = options.threads {
                own = own.threads(threads);
            }
            let own = own.engine(options.engine).encoding(options.encoding).connect();
            Box::new(SphereClient(own.map_err(Error::from)?))
        }
    })
}

struct BoxClient(TimedClient);

impl Client for BoxClient {
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        let mut pairs = None;
        let frame = self.0.frame(boxes, |mask| pairs = wants_pairs.then(|| sorted(mask)))?;
        Ok(Answer { frame, pairs })
    }

    fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        truth::pairs(boxes, engine)
    }
}

fn sorted(mask: &PairMask) -> Vec<Pair> {
    let mut pairs = mask.to_vec();
    pairs.sort_unstable();
    pairs
}

/// Factor of the scene's coordinates in the world. It moves them between f32 numbers: otherwise
/// they would be exact f32 again relative to the origin.
const STRETCH: f64 = 1.0 + 1e-7;

struct WorldClient {
    session: Session,
    world: World,
    /// The origin of the f32 boxes: the middle of the first frame's scene.
    origin: DVec3,
    boxes: Vec<Faces>,
}

impl WorldClient {
    fn new(session: Session, world: World, boxes: &[Aabb]) -> Self {
        let around = Bounds::around(boxes);
        let corner = |corner| Vec3::from_array(corner).as_dvec3();
        let middle = corner(around.low()).midpoint(corner(around.high()));
        Self { session, world, origin: middle + world.offset, boxes: Vec::new() }
    }

    fn place(&mut self, boxes: &[Aabb]) {
        let place = |x: f32| self.world.offset + STRETCH * f64::from(x);
        self.boxes.clear();
        self.boxes.extend(boxes.iter().map(|b| [b.min, b.max].map(|corner| corner.map(place))));
    }
}

impl Client for WorldClient {
    /// The world's boxes exist before the clock starts; their conversion to f32 is timed.
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        self.place(boxes);
        let Self { session, world, origin, boxes } = self;
        let start = Instant::now();
        let mut frame = session.frame(boxes.len())?;
        for (to, [min, max]) in frame.boxes_mut().iter_mut().zip(&*boxes) {
            *to = if world.is_plain {
                Aabb { min: min.map(|x| x as f32), max: max.map(|x| x as f32) }
            } else {
                Aabb::outward_from_f64(*min, *max, *origin)
            };
        }
        let filled = Instant::now();
        let mask = frame.submit()?.wait()?;
        Answer::of(&mask, [start, filled, Instant::now()], wants_pairs)
    }

    fn truth(&self, _: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        world_pairs(&self.boxes, self.origin, engine)
    }
}

/// The pairs of a world in f64: each box compared with each; in a large world, candidates are the
/// pairs of f32 boxes that are wider by a step on each side.
fn world_pairs(boxes: &[Faces], origin: DVec3, engine: EngineId) -> Result<Vec<Pair>, TimedError> {
    if boxes.len() <= truth::NAIVE_LIMIT {
        return Ok(truth_of_faces(boxes).pairs);
    }
    let origin = origin.to_array();
    let wide = |[min, max]: &Faces| Aabb {
        min: std::array::from_fn(|axis| outward(min[axis] - origin[axis], false)),
        max: std::array::from_fn(|axis| outward(max[axis] - origin[axis], true)),
    };
    let mut pairs = truth::pairs(&boxes.iter().map(wide).collect::<Vec<_>>(), engine)?;
    pairs.retain(|&[a, b]| {
        let ([p_min, p_max], [q_min, q_max]) = (&boxes[a as usize], &boxes[b as usize]);
        (0..3).all(|axis| {
            let solid = p_min[axis] <= p_max[axis] && q_min[axis] <= q_max[axis];
            solid && p_min[axis] <= q_max[axis] && q_min[axis] <= p_max[axis]
        })
    });
    Ok(pairs)
}

struct SphereClient(Session);

impl Client for SphereClient {
    /// The fill is the time to make spheres of the boxes.
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        let start = Instant::now();
        let mut frame = self.0.sphere_frame(boxes.len())?;
        for (to, b) in frame.spheres_mut().iter_mut().zip(boxes) {
            *to = sphere(b);
        }
        let filled = Instant::now();
        let mask = frame.submit()?.wait()?;
        Answer::of(&mask, [start, filled, Instant::now()], wants_pairs)
    }

    fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        sphere_pairs(&boxes.iter().map(sphere).collect::<Vec<_>>(), engine)
    }

    fn stands_for_boxes(&self) -> bool {
        true
    }
}

/// A sphere that holds a box. Empty and invalid boxes become spheres of the same class; around a box with an infinite
/// face it is all of space.
fn sphere(b: &Aabb) -> Sphere {
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
    let corner = (0..3).map(|axis| {
        let [min, max, middle] = [b.min[axis], b.max[axis], center[axis]].map(f64::from);
        f64::max(middle - min, max - middle).powi(2)
    });
    Sphere::new(center, outward(corner.sum::<f64>().sqrt(), true))
}

/// The exact pairs of spheres: each compared with each; in a large scene, candidates are the pairs of
/// boxes that are wider by a step on each side.
fn sphere_pairs(spheres: &[Sphere], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
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
    let overlap = |&[a, b]: &Pair| oracle::overlap(&spheres[a as usize], &spheres[b as usize]);
    Ok(candidates.into_par_iter().filter(overlap).collect())
}

#[cfg(test)]
mod tests {
    use pairmask_core::EngineName;
    use pairmaskd::scene::{Random, Scene, SceneName};

    use super::*;

    fn world_client(offset: f64, is_plain: bool, boxes: &[Aabb]) -> WorldClient {
        let session = Session::builder().backend(Backend::InProcess).connect();
        let session = session.unwrap_or_else(|e| panic!("{e}"));
        WorldClient::new(session, World { offset, is_plain }, boxes)
    }

    #[test]
    fn an_origin_keeps_pairs_apart_and_plain_f32_does_not() -> Result<(), TimedError> {
        let scene = Scene::new(SceneName::Pile, 1_000, 1);
        let found = |offset, is_plain| {
            let mut client = world_client(offset, is_plain, scene.boxes());
            let answer = client.frame(scene.boxes(), true)?;
            let is_f32 = |x: &f64| f64::from((x - 1e6) as f32) == x - 1e6;
            let coordinates = client.boxes.as_flattened().as_flattened();
            let count = coordinates.iter().filter(|x| is_f32(x)).count();
            assert!(count < 3_000 || offset != 1e6, "{count} of 6,000 coordinates are f32 numbers");
            let truth = client.truth(scene.boxes(), answer.frame.info.engine)?;
            Ok::<_, TimedError>(truth::Difference::between(
                &answer.pairs.unwrap_or_default(),
                &truth,
            ))
        };
        for offset in [0.0, 1e6, 1e9] {
            let by_origin = found(offset, false)?;
            assert!(by_origin.true_pairs > 1_000 && by_origin.missed == 0, "{by_origin:?}");
            assert!(by_origin.extra < 10, "{offset}: {by_origin:?}");
            let plain = found(offset, true)?;
            assert_eq!((plain.true_pairs, plain.missed), (by_origin.true_pairs, 0));
            assert!(plain.extra < 10 || offset >= 1e6, "{offset}: {plain:?}");
            assert!(plain.extra > 100_000 || offset < 1e9, "{offset}: {plain:?}");
        }
        Ok(())
    }

    #[test]
    fn large_scenes_have_the_pairs_that_two_loops_find() -> Result<(), TimedError> {
        let n = truth::NAIVE_LIMIT + 1;
        let scene = Scene::new(SceneName::Mixed, n, 1);
        let mut client = world_client(1e9, false, scene.boxes());
        client.place(scene.boxes());
        let by_engine = client.truth(scene.boxes(), EngineName::CpuGrid.into())?;
        assert_eq!(by_engine, truth_of_faces(&client.boxes).pairs);
        let mut random = Random::new(7);
        let mut one = || Sphere::new([(); 3].map(|()| 16.0 * random.unit()), random.unit());
        let mut spheres: Vec<Sphere> = (0..n).map(|_| one()).collect();
        spheres[7] = Sphere::EMPTY;
        spheres[8].radius = f32::INFINITY;
        spheres[9].center[1] = f32::NAN;
        assert_eq!(sphere_pairs(&spheres, EngineName::CpuSap.into())?, oracle::pairs(&spheres));
        Ok(())
    }

    #[test]
    fn spheres_hold_their_boxes() {
        let scene = Scene::new(SceneName::Mixed, 2_000, 3);
        for b in scene.boxes() {
            let around = sphere(b);
            for corner in 0..8 {
                let corner: [f32; 3] = std::array::from_fn(|axis| {
                    if corner >> axis & 1 == 0 { b.min[axis] } else { b.max[axis] }
                });
                assert!(oracle::overlap(&around, &Sphere::new(corner, 0.0)), "{b:?} {around:?}");
            }
        }
        assert_eq!(sphere(&Aabb::EMPTY).class(), BoxClass::Empty);
        let nan = Aabb { min: [f32::NAN; 3], max: [1.0; 3] };
        assert_eq!(sphere(&nan).class(), BoxClass::Invalid);
        let half = Aabb { min: [f32::NEG_INFINITY, 1.0, 1.0], max: [-3.0, 2.0, f32::INFINITY] };
        let s = sphere(&half);
        assert_eq!((s.class(), s.radius), (BoxClass::Solid, f32::INFINITY), "{s:?}");
    }
}
