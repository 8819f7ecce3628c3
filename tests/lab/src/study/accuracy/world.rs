//! The scene in a world of f64 coordinates, far from their origin.

use glam::{DVec3, Vec3};
use pairmask::Session;
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::{Faces, truth_of_faces};
use pairmask_core::{Aabb, Bounds};
use pairmaskd::timed_client::{Decoding, TimedClient, TimedError};

use super::contender::{Answer, Contender, FrameFigures, sorted};
use super::mode::{Rounding, World};
use super::truth::{self, Pair, outward};

/// Factor of the scene's coordinates in the world. It moves them between f32 numbers: otherwise
/// they would be exact f32 again relative to the origin.
const STRETCH: f64 = 1.0 + 1e-7;

/// A client of such a world.
pub struct WorldClient {
    session: Session,
    world: World,
    /// The origin of the f32 boxes: the middle of the first frame's scene.
    origin: DVec3,
    boxes: Vec<Faces>,
}

impl WorldClient {
    /// A client whose first frame's scene is `boxes`.
    pub fn new(session: Session, world: World, boxes: &[Aabb]) -> Self {
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

impl Contender for WorldClient {
    /// The world's boxes exist before the clock starts; their conversion to f32 is timed.
    fn frame(&mut self, boxes: &[Aabb], wants_pairs: bool) -> Result<Answer, TimedError> {
        self.place(boxes);
        let Self { session, world, origin, boxes } = self;
        let write = |to: &mut [Aabb]| match world.rounding {
            Rounding::ByOrigin => {
                for (to, [min, max]) in to.iter_mut().zip(&*boxes) {
                    *to = Aabb::outward_from_f64(*min, *max, *origin);
                }
            }
            Rounding::Plain => {
                for (to, [min, max]) in to.iter_mut().zip(&*boxes) {
                    *to = Aabb { min: min.map(|x| x as f32), max: max.map(|x| x as f32) };
                }
            }
        };
        let mut pairs = None;
        let look = |mask: &_| pairs = wants_pairs.then(|| sorted(mask));
        let frame =
            TimedClient::written_frame(session, boxes.len(), write, &mut Decoding::Serial, look)?;
        Ok(Answer { figures: FrameFigures::from(&frame), pairs })
    }

    fn truth(&self, _: &[Aabb], engine: EngineId) -> Result<Vec<Pair>, TimedError> {
        pairs(&self.boxes, self.origin, engine)
    }
}

/// The pairs of a world in f64: each box compared with each; in a large world, candidates are the
/// pairs of f32 boxes that are wider by a step on each side.
fn pairs(boxes: &[Faces], origin: DVec3, engine: EngineId) -> Result<Vec<Pair>, TimedError> {
    if boxes.len() <= truth::NAIVE_LIMIT {
        return Ok(truth_of_faces(boxes).pairs);
    }
    let origin = origin.to_array();
    let wide = |[min, max]: &Faces| Aabb {
        min: std::array::from_fn(|axis| outward(min[axis] - origin[axis], false)),
        max: std::array::from_fn(|axis| outward(max[axis] - origin[axis], true)),
    };
    let mut pairs = truth::pairs(&boxes.iter().map(wide).collect::<Vec<_>>(), engine)?;
    pairs.retain(|&(a, b)| {
        let ([p_min, p_max], [q_min, q_max]) = (&boxes[a as usize], &boxes[b as usize]);
        (0..3).all(|axis| {
            let solid = p_min[axis] <= p_max[axis] && q_min[axis] <= q_max[axis];
            solid && p_min[axis] <= q_max[axis] && q_min[axis] <= p_max[axis]
        })
    });
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use pairmask::Backend;
    use pairmaskd::scene::{Scene, SceneName};

    use super::*;

    fn client(offset: f64, rounding: Rounding, boxes: &[Aabb]) -> WorldClient {
        let session = Session::builder().backend(Backend::InProcess).connect();
        let session = session.unwrap_or_else(|e| panic!("{e}"));
        WorldClient::new(session, World { offset, rounding }, boxes)
    }

    fn missed_and_extra(offset: f64, rounding: Rounding, n: usize) -> Result<[u64; 3], TimedError> {
        let scene = Scene::new(SceneName::Pile, n, 1);
        let mut client = client(offset, rounding, scene.boxes());
        let answer = client.frame(scene.boxes(), true)?;
        let truth = client.truth(scene.boxes(), answer.figures.engine)?;
        let found = truth::Difference::between(&answer.pairs.unwrap_or_default(), &truth);
        Ok([found.true_pairs, found.missed, found.extra])
    }

    #[test]
    fn an_origin_keeps_pairs_apart_and_plain_f32_does_not() -> Result<(), TimedError> {
        for offset in [0.0, 1e6, 1e9] {
            let [pairs, missed, extra] = missed_and_extra(offset, Rounding::ByOrigin, 1_000)?;
            assert!(pairs > 1_000 && missed == 0 && extra < 10, "{offset}: {pairs} {extra}");
            let [same, missed, extra] = missed_and_extra(offset, Rounding::Plain, 1_000)?;
            assert_eq!((same, missed), (pairs, 0));
            assert!(extra < 10 || offset >= 1e6, "{offset}: {extra}");
            assert!(extra > 100_000 || offset < 1e9, "{offset}: {extra}");
        }
        Ok(())
    }

    #[test]
    fn large_worlds_have_the_pairs_that_two_loops_find() -> Result<(), TimedError> {
        let scene = Scene::new(SceneName::Mixed, truth::NAIVE_LIMIT + 1, 1);
        let mut client = client(1e9, Rounding::ByOrigin, scene.boxes());
        client.place(scene.boxes());
        let by_engine = client.truth(scene.boxes(), pairmask_core::EngineName::CpuGrid.into())?;
        assert_eq!(by_engine, truth_of_faces(&client.boxes).pairs);
        Ok(())
    }

    #[test]
    fn the_world_is_not_made_of_f32() {
        let scene = Scene::new(SceneName::Uniform, 1_000, 1);
        let mut client = client(1e6, Rounding::ByOrigin, scene.boxes());
        client.place(scene.boxes());
        let is_f32 = |x: &f64| f64::from((x - 1e6) as f32) == x - 1e6;
        let count = client.boxes.as_flattened().as_flattened().iter().filter(|x| is_f32(x)).count();
        assert!(count < 3_000, "{count} of 6,000 coordinates are f32 numbers");
    }
}
