//! Seeded scenes in motion, for the command line, the benches and the tests.
//!
//! The same name, n and seed give the same boxes and the same motion, frame by frame, on every
//! machine with IEEE floats. A test checks the pairs a box of the four scenes of the anchors; the
//! papers' scenes follow Avril et al. (2009 to 2014): columns of like or unlike objects that fall
//! on a plane.
//!
//! ```
//! use pairmaskd::scene::{Scene, SceneName};
//! let mut scene = Scene::new(SceneName::Uniform, 1_000, 1);
//! let first = scene.boxes()[0];
//! scene.step();
//! assert_ne!(first, scene.boxes()[0]);
//! ```

mod columns;
mod motion;
mod name;
mod random;
mod spread;
mod worst;

pub use motion::{STEP_SHARE, Walls};
pub use name::SceneName;
pub use random::Random;

use pairmask_core::Aabb;

/// Boxes and how they move.
#[derive(Clone, Debug)]
pub struct Scene {
    boxes: Vec<Aabb>,
    velocities: Vec<[f32; 3]>,
    walls: Walls,
}

impl Scene {
    /// `n` boxes of the named kind.
    pub fn new(name: SceneName, n: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        match name {
            SceneName::Uniform => spread::uniform(n, &mut random),
            SceneName::Mixed => spread::mixed(n, &mut random),
            SceneName::Pile => spread::pile(n, &mut random),
            SceneName::Plane => spread::plane(n, &mut random),
            SceneName::Cubes => columns::falling(n, &mut random, columns::cube),
            SceneName::Balls => columns::falling(n, &mut random, columns::ball),
            SceneName::Skittles => columns::falling(n, &mut random, columns::skittle),
            SceneName::Torus => columns::falling(n, &mut random, columns::torus),
            SceneName::Letters => columns::falling(n, &mut random, columns::letter),
            SceneName::OneCell => worst::one_cell(n, &mut random),
            SceneName::Rods => worst::rods(n, &mut random),
            SceneName::Giants => worst::giants(n, &mut random),
            SceneName::Far => worst::far(n, &mut random),
            SceneName::Identical => worst::identical(n, &mut random),
        }
    }

    /// Given boxes, set in motion within their own finite bounds.
    pub fn from_boxes(boxes: Vec<Aabb>, seed: u64) -> Self {
        let walls = Walls::Scene {
            low: bound(&boxes, |b, axis| b.min[axis], f32::min, f32::INFINITY),
            high: bound(&boxes, |b, axis| b.max[axis], f32::max, f32::NEG_INFINITY),
        };
        Self::drifting(boxes, walls, &mut Random::new(seed))
    }

    /// The boxes of this frame, in object order.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Moves the boxes to the next frame. Allocates nothing.
    pub fn step(&mut self) {
        motion::advance(&mut self.boxes, &mut self.velocities, &self.walls);
    }

    /// Each box with a direction of its own.
    fn drifting(boxes: Vec<Aabb>, walls: Walls, random: &mut Random) -> Self {
        let velocities = boxes
            .iter()
            .map(|b| {
                let step = STEP_SHARE * mean_edge(b);
                random.direction().map(|d| d * step)
            })
            .collect();
        Self { boxes, velocities, walls }
    }

    /// Each box with the velocity that `velocity` gives it.
    fn moving(boxes: Vec<Aabb>, walls: Walls, velocity: impl FnMut(&Aabb) -> [f32; 3]) -> Self {
        let velocities = boxes.iter().map(velocity).collect();
        Self { boxes, velocities, walls }
    }
}

/// Mean of the finite edges, 0 where there is none.
fn mean_edge(b: &Aabb) -> f32 {
    let finite = (0..3).map(|axis| b.max[axis] - b.min[axis]).filter(|e| e.is_finite() && *e > 0.0);
    let (sum, count) = finite.fold((0.0, 0), |(sum, count), e| (sum + e, count + 1));
    if count == 0 { 0.0 } else { sum / count as f32 }
}

/// The outermost finite coordinate on each axis, 0 where there is none.
fn bound(
    boxes: &[Aabb],
    of: impl Fn(&Aabb, usize) -> f32,
    outer: impl Fn(f32, f32) -> f32,
    start: f32,
) -> [f32; 3] {
    std::array::from_fn(|axis| {
        let outermost =
            boxes.iter().map(|b| of(b, axis)).filter(|x| x.is_finite()).fold(start, &outer);
        if outermost.is_finite() { outermost } else { 0.0 }
    })
}

/// A box of three edges around a centre.
fn around(centre: [f32; 3], edges: [f32; 3]) -> Aabb {
    Aabb {
        min: std::array::from_fn(|axis| centre[axis] - 0.5 * edges[axis]),
        max: std::array::from_fn(|axis| centre[axis] + 0.5 * edges[axis]),
    }
}

#[cfg(test)]
mod tests;
