//! Who answers the frames of a row: a session boxes or a world in f64, this process spheres.

use std::time::Instant;

use glam::{DVec3, Vec3};
use pairmask::{Backend, Error, PairMask, Session};
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::{Faces, Pair};
use pairmask_core::sphere::Sphere;
use pairmask_core::{Aabb, Bounds, BoxClass};
use pairmaskd::timed_client::{Decoding, TimedClient, TimedError, TimedFrame};
use rayon::prelude::*;

use super::mode::StudyMode;
use super::truth::{self, outward};
use crate::study::spheres::oracle;

/// A way to answer the frames of a scene, and its right answers.
#[allow(clippy::large_enum_variant)] // One of a measurement.
pub enum Client {
    Boxes(TimedClient),
    World(WorldClient),
    Spheres(Session),
}

#[derive(Clone, Debug)]
pub struct Answer {
    pub frame: TimedFrame,
    pub pairs: Option<Vec<Pair>>,
}

impl Client {
    /// Spheres are culled in this process, by the engine of `options`; all others in the session.
    pub fn new(
        mode: StudyMode,
        options: &CullOptions,
        session: Session,
        boxes: &[Aabb],
    ) -> Result<Self, TimedError> {
        Ok(match mode {
            StudyMode::Sent(precision) => Self::Boxes(TimedClient::new(session, precision, boxes)),
            StudyMode::F64(offset) => Self::World(WorldClient::new(session, offset, false, boxes)),
            StudyMode::PlainF32(offset) => {
                Self::World(WorldClient::new(session, offset, true, boxes))
            }
            StudyMode::Spheres => {
                let mut own = Session::builder().backend(Backend::InProcess).answer_repeats(false);
                if let Some(threads) = options.threads {
                    own = own.threads(threads);
                }
                let own = own.engine(options.engine).encoding(options.encoding).connect();
                Self::Spheres(own.map_err(Error::from)?)
            }
        })
    }

    /// Answers a frame of boxes. The answer has `pairs` if `lists_pairs`.
    pub fn frame(&mut self, boxes: &[Aabb], lists_pairs: bool) -> Result<Answer, TimedError> {
        let mut pairs = None;
        let mut look = |mask: &PairMask| {
            pairs = lists_pairs.then(|| {
                let mut pairs = mask.to_vec();
                pairs.sort_unstable();
                pairs
            });
        };
        let (pending, start, filled) = match self {
            Self::Boxes(client) => {
                let frame = client.frame(boxes, &Decoding::default(), look)?;
                return Ok(Answer { frame, pairs });
            }
            // The world's boxes exist before the clock starts; their conversion to f32 is timed.
            Self::World(client) => {
                client.put(boxes);
                let start = Instant::now();
                let mut frame = client.session.frame(boxes.len())?;
                for (to, [min, max]) in frame.boxes_mut().iter_mut().zip(&client.boxes) {
                    *to = if client.is_plain {
                        Aabb { min: min.map(|x| x as f32), max: max.map(|x| x as f32) }
                    } else {
                        Aabb::outward_from_f64(*min, *max, client.origin)
                    };
                }
                let filled = Instant::now();
                (frame.submit()?, start, filled)
            }
            // The fill is the time to make spheres of the boxes.
            Self::Spheres(session) => {
                let start = Instant::now();
                let mut frame = session.sphere_frame(boxes.len())?;
                for (to, b) in frame.spheres_mut().iter_mut().zip(boxes) {
                    *to = sphere(b);
                }
                let filled = Instant::now();
                (frame.submit()?, start, filled)
            }
        };
        let mask = pending.wait()?;
        let times = [start, filled, Instant::now()];
        let frame = TimedFrame::of(&mask, &Decoding::default(), true, times)?;
        look(&mask);
        Ok(Answer { frame, pairs })
    }

    /// The right pairs of the last frame, sorted, found in another way than by `engine`.
    pub fn truth(&self, boxes: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        match self {
            Self::Boxes(_) => truth::pairs(boxes, engine),
            Self::World(client) => world_pairs(&client.boxes, client.origin, engine),
            Self::Spheres(_) => sphere_pairs(&boxes.iter().map(sphere).collect::<Vec<_>>(), engine),
        }
    }
}

/// Factor of the scene's coordinates in the world. It moves them between f32 numbers: otherwise
/// they would be exact f32 again relative to the origin.
const STRETCH: f64 = 1.0 + 1e-7;

pub struct WorldClient {
    session: Session,
    offset: f64,
    is_plain: bool,
    /// The origin of the f32 boxes: the middle of the first frame's scene.
    origin: DVec3,
    boxes: Vec<Faces>,
}

impl WorldClient {
    fn new(session: Session, offset: f64, is_plain: bool, boxes: &[Aabb]) -> Self {
        let around = Bounds::around(boxes);
        let corner = |corner| Vec3::from_array(corner).as_dvec3();
        let middle = corner(around.low()).midpoint(corner(around.high()));
        Self { session, offset, is_plain, origin: middle + offset, boxes: Vec::new() }
    }

    fn put(&mut self, boxes: &[Aabb]) {
        let put = |x: f32| self.offset + STRETCH * f64::from(x);
        self.boxes.clear();
        self.boxes.extend(boxes.iter().map(|b| [b.min, b.max].map(|corner| corner.map(put))));
    }
}

/// The pairs of a world in f64.
fn world_pairs(boxes: &[Faces], origin: DVec3, engine: EngineId) -> Result<Vec<Pair>, TimedError> {
    let wide = |[min, max]: &Faces| Aabb {
        min: std::array::from_fn(|axis| outward(min[axis] - origin[axis], false)),
        max: std::array::from_fn(|axis| outward(max[axis] - origin[axis], true)),
    };
    exact_pairs(boxes, wide, engine, |[p_min, p_max], [q_min, q_max]| {
        (0..3).all(|axis| {
            let valid = p_min[axis] <= p_max[axis] && q_min[axis] <= q_max[axis];
            valid && p_min[axis] <= q_max[axis] && q_min[axis] <= p_max[axis]
        })
    })
}

/// The pairs of objects that overlap by an exact test; candidates are the pairs of f32 boxes that are wider by a step
/// on each side.
fn exact_pairs<T: Sync>(
    objects: &[T],
    wide: impl Fn(&T) -> Aabb,
    engine: EngineId,
    overlap: impl Fn(&T, &T) -> bool + Sync,
) -> Result<Vec<Pair>, TimedError> {
    let overlap = |[a, b]: &Pair| overlap(&objects[*a as usize], &objects[*b as usize]);
    let candidates = truth::pairs(&objects.iter().map(wide).collect::<Vec<_>>(), engine)?;
    Ok(candidates.into_par_iter().filter(overlap).collect())
}

/// A sphere that holds a box. Empty and invalid boxes become spheres of the same class; around a box with an infinite
/// face it is all of space.
fn sphere(b: &Aabb) -> Sphere {
    match b.class() {
        BoxClass::Empty => return Sphere::EMPTY,
        BoxClass::Invalid => return Sphere::new([f32::NAN; 3], 0.0),
        BoxClass::Valid => {}
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

/// The exact pairs of spheres.
fn sphere_pairs(spheres: &[Sphere], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
    let wide = |s: &Sphere| match s.class() {
        BoxClass::Valid => Aabb {
            min: s.center.map(|x| outward(f64::from(x) - f64::from(s.radius), false)),
            max: s.center.map(|x| outward(f64::from(x) + f64::from(s.radius), true)),
        },
        BoxClass::Empty | BoxClass::Invalid => Aabb::EMPTY,
    };
    exact_pairs(spheres, wide, engine, oracle::overlap)
}

#[cfg(test)]
mod tests {
    use pairmask_core::EngineName;
    use pairmask_core::oracle::truth_of_faces;
    use pairmaskd::scene::{Random, Scene, SceneName};

    use super::*;

    fn world_client(offset: f64, boxes: &[Aabb]) -> WorldClient {
        let session = Session::builder().backend(Backend::InProcess).connect().expect("a session");
        WorldClient::new(session, offset, false, boxes)
    }

    #[test]
    fn an_origin_keeps_pairs_apart() -> Result<(), TimedError> {
        let scene = Scene::new(SceneName::Pile, 1_000, 1);
        for offset in [0.0, 1e6, 1e9] {
            let mut world = world_client(offset, scene.boxes());
            world.put(scene.boxes());
            let is_f32 = |x: &&f64| f64::from((**x - 1e6) as f32) == **x - 1e6;
            let count = world.boxes.as_flattened().as_flattened().iter().filter(is_f32).count();
            assert!(count < 3_000 || offset != 1e6, "{count} of 6,000 coordinates are f32 numbers");
            let mut client = Client::World(world);
            let answer = client.frame(scene.boxes(), true)?;
            let truth = client.truth(scene.boxes(), answer.frame.info.engine)?;
            let found = truth::Difference::between(&answer.pairs.unwrap_or_default(), &truth);
            assert!(found.true_pairs > 1_000 && found.missed == 0 && found.extra < 10, "{found:?}");
        }
        Ok(())
    }

    #[test]
    fn large_scenes_have_the_pairs_that_two_loops_find() -> Result<(), TimedError> {
        let n = truth::NAIVE_LIMIT + 1;
        let scene = Scene::new(SceneName::Mixed, n, 1);
        let mut client = world_client(1e9, scene.boxes());
        client.put(scene.boxes());
        let by_engine = world_pairs(&client.boxes, client.origin, EngineName::CpuGrid.into())?;
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
        assert_eq!((s.class(), s.radius), (BoxClass::Valid, f32::INFINITY), "{s:?}");
    }
}
