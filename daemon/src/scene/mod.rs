//! Seeded scenes in motion, for the command line, the benches and the tests.
//!
//! The same name, n and seed give the same boxes and the same motion, frame by frame, on every
//! machine with IEEE floats. A test checks the pairs a box of the four scenes of the anchors; the
//! papers' scenes follow Avril et al. (2009 to 2014): columns of like or unlike objects that fall
//! on a plane.
//!
//! A small deterministic generator, so that a seed gives the same scene on every machine.
//!
//! `SplitMix64` (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators"): one
//! add and three multiply-xorshift steps a number. It passes `BigCrush`; scenes need no more.

mod kinds;

use std::fmt;
use std::str::FromStr;

use pairmask_core::Aabb;
use pairmask_core::engine::UnknownName;

#[derive(Clone, Debug)]
pub struct Scene {
    boxes: Vec<Aabb>,
    velocities: Vec<[f32; 3]>,
    walls: Walls,
}

impl Scene {
    pub fn new(name: SceneName, n: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        name.make()(n, &mut random)
    }

    /// Given boxes, set in motion within their own finite bounds.
    pub fn from_boxes(boxes: Vec<Aabb>, seed: u64) -> Self {
        let walls = Walls::Scene {
            low: bound(&boxes, |b, axis| b.min[axis], f32::min, f32::INFINITY),
            high: bound(&boxes, |b, axis| b.max[axis], f32::max, f32::NEG_INFINITY),
        };
        Self::drifting(boxes, walls, &mut Random::new(seed))
    }

    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Moves the boxes to the next frame. Allocates nothing.
    pub fn step(&mut self) {
        advance(&mut self.boxes, &mut self.velocities, &self.walls);
    }

    /// Each box with a direction of its own.
    fn drifting(boxes: Vec<Aabb>, walls: Walls, random: &mut Random) -> Self {
        Self::moving(boxes, walls, |b| {
            let step = STEP_SHARE * mean_edge(b);
            random.direction().map(|d| d * step)
        })
    }

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

fn around(centre: [f32; 3], edges: [f32; 3]) -> Aabb {
    Aabb {
        min: std::array::from_fn(|axis| centre[axis] - 0.5 * edges[axis]),
        max: std::array::from_fn(|axis| centre[axis] + 0.5 * edges[axis]),
    }
}

type Make = fn(usize, &mut Random) -> Scene;

macro_rules! scene_names {
    ($($(#[$doc:meta])* $name:ident = $text:literal, $make:expr;)+) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum SceneName {
            $($(#[$doc])* $name,)+
        }

        impl SceneName {
            /// Every scene: the four of the anchors, the papers' five, the worst cases.
            pub const ALL: [Self; [$($text),+].len()] = [$(Self::$name),+];

            pub const fn as_str(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)+
                }
            }

            fn make(self) -> Make {
                match self {
                    $(Self::$name => $make,)+
                }
            }
        }
    };
}

scene_names! {
    /// Edges 0.8 to 1.2 in a cube, about 1 pair a box.
    Uniform = "uniform", kinds::uniform;
    /// Edges log-uniform from 0.01 to 10, about 2 pairs a box.
    Mixed = "mixed", kinds::mixed;
    /// A heap of radius 4 × height in a jittered brick lattice, about 7 pairs a box.
    Pile = "pile", kinds::pile;
    /// Every z overlaps; Gaussian blobs of 2,000 boxes, about 3 pairs a box.
    Plane = "plane", kinds::plane;
    /// Falling columns of turned cubes (papers 2009 to 2014): edges of a box 1 to √3.
    Cubes = "cubes", |n, random| kinds::falling(n, random, |random| kinds::turned([0.8; 3], random));
    /// Falling columns of balls (papers 2009 to 2014): every box is the same cube.
    Balls = "balls", |n, random| kinds::falling(n, random, |_| [1.0; 3]);
    /// Falling columns of skittles: tall and thin, turned (papers 2009 to 2014).
    Skittles = "skittles", |n, random| {
        kinds::falling(n, random, |random| kinds::turned([0.4, 0.4, 1.2], random))
    };
    /// Falling columns of tori: wide and flat, turned (paper 2014).
    Torus = "torus", |n, random| {
        kinds::falling(n, random, |random| kinds::turned([1.0, 1.0, 0.3], random))
    };
    /// Falling columns of letters: unlike objects (paper 2014).
    Letters = "letters", |n, random| kinds::falling(n, random, kinds::letter);
    /// A uniform scene, and eight boxes so far off that a grid over the bounds has one full cell.
    OneCell = "one-cell", kinds::one_cell;
    /// Thin rods, 40 times as long as wide, along any axis.
    Rods = "rods", kinds::rods;
    /// Dust, a few huge boxes, an infinite ground and one box that covers everything.
    Giants = "giants", kinds::giants;
    /// A uniform scene where a float's step is up to a sixteenth of a box.
    Far = "far", kinds::far;
    /// All boxes the same: every pair overlaps, n(n − 1)/2 of them.
    Identical = "identical", kinds::identical;
}

impl SceneName {
    /// Whether the number of pairs grows with the square of n, so that no engine can be fast.
    pub const fn is_quadratic(self) -> bool {
        matches!(self, Self::Identical)
    }
}

impl fmt::Display for SceneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for SceneName {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL.into_iter().find(|name| name.as_str() == s).ok_or_else(|| UnknownName {
            name: s.to_owned(),
            known: Self::ALL.map(Self::as_str).join(", ").into(),
        })
    }
}

/// Share of a box's mean edge that it moves in a frame, as in the anchors: at 60 frames a second it
/// crosses its own length in under a second.
pub const STEP_SHARE: f32 = 0.02;

/// The walls at which boxes turn round.
#[derive(Clone, Debug)]
pub enum Walls {
    /// Every box stays between the same two corners (of its centre).
    Scene { low: [f32; 3], high: [f32; 3] },
    /// Every box stays within `radius` of its first centre on each axis: a heap keeps its shape.
    Cage { home: Vec<[f32; 3]>, radius: f32 },
    /// Boxes reflect at the sides; one that falls below the floor comes back at the top.
    Falling { low: [f32; 3], high: [f32; 3] },
}

/// Moves every box, turning it round at its walls. Infinite coordinates stay as they are.
pub fn advance(boxes: &mut [Aabb], velocities: &mut [[f32; 3]], walls: &Walls) {
    match walls {
        Walls::Scene { low, high } => {
            for (b, v) in boxes.iter_mut().zip(velocities) {
                reflect(b, v, low, high);
            }
        }
        Walls::Cage { home, radius } => {
            for ((b, v), home) in boxes.iter_mut().zip(velocities).zip(home) {
                reflect(b, v, &home.map(|h| h - radius), &home.map(|h| h + radius));
            }
        }
        Walls::Falling { low, high } => {
            let height = high[2] - low[2];
            for (b, v) in boxes.iter_mut().zip(velocities) {
                let floorless = [low[0], low[1], f32::NEG_INFINITY];
                reflect(b, v, &floorless, high);
                let lift = if 0.5 * (b.min[2] + b.max[2]) < low[2] { height } else { 0.0 };
                b.min[2] += lift;
                b.max[2] += lift;
            }
        }
    }
}

/// One step of one box. Selects instead of branches, so that it runs at the speed of memory.
#[inline]
fn reflect(b: &mut Aabb, v: &mut [f32; 3], low: &[f32; 3], high: &[f32; 3]) {
    for axis in 0..3 {
        let centre = 0.5 * b.min[axis] + 0.5 * b.max[axis] + v[axis];
        // The velocity is set inwards, not just reversed: a box that starts outside comes back in
        // and stays.
        let speed = v[axis].abs();
        let turned = if centre > high[axis] { -speed } else { v[axis] };
        v[axis] = if centre < low[axis] { speed } else { turned };
        b.min[axis] += v[axis];
        b.max[axis] += v[axis];
    }
}

#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    pub const fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1), 24 bits of it: every value is exact in f32.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in [0, bound). `bound` must not be 0.
    pub fn below(&mut self, bound: u64) -> u64 {
        // Multiply-shift: the bias is below bound / 2^64.
        ((u128::from(self.bits()) * u128::from(bound)) >> 64) as u64
    }

    /// Log-uniform in [low, high): every decade is as likely.
    pub fn log_range(&mut self, low: f32, high: f32) -> f32 {
        self.range(low.ln(), high.ln()).exp()
    }

    /// Standard normal (Box-Muller, one of the two).
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f32::consts::TAU * self.unit()).cos()
    }

    /// A direction, uniform on the sphere.
    pub fn direction(&mut self) -> [f32; 3] {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = (std::f32::consts::TAU * self.unit()).sin_cos();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        [radius * cos, radius * sin, z]
    }
}

#[cfg(test)]
mod tests;
