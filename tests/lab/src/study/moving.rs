//! Scenes of which some boxes move in each frame, for measurements of persistent scenes.

use clap::ValueEnum;
use pairmask_core::Aabb;
use pairmaskd::scene::{Random, Scene, SceneName};

/// How far a box moves in a frame, of its edge.
const STEP: f32 = 0.05;

/// How boxes move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Motion {
    /// The same boxes, each always the same way.
    Drift,
    /// Other boxes each frame, to and fro.
    Jitter,
    /// Other boxes each frame, to anywhere in the scene.
    Teleport,
    /// Other boxes each frame are removed, and new ones take their indices, anywhere.
    Spawn,
}

impl Motion {
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }
}

#[derive(Clone)]
pub struct World {
    boxes: Vec<Aabb>,
    random: Random,
    /// The indices in an order of chance: movers are a stretch of it.
    shuffled: Vec<u32>,
    next: usize,
}

impl World {
    pub fn new(name: SceneName, n: usize) -> Self {
        let mut random = Random::new(3);
        let mut shuffled: Vec<u32> = (0..n as u32).collect();
        for i in (1..n).rev() {
            shuffled.swap(i, random.below(i as u64 + 1) as usize);
        }
        Self { boxes: Scene::new(name, n, 1).boxes().to_vec(), random, shuffled, next: 0 }
    }

    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Moves some boxes; their indices, rising, and where they are now.
    pub fn step(&mut self, count: usize, motion: Motion) -> (Vec<u32>, Vec<Aabb>) {
        let n = self.boxes.len();
        let first = if motion == Motion::Drift { 0 } else { self.next };
        let mut indices: Vec<u32> = (0..count).map(|i| self.shuffled[(first + i) % n]).collect();
        indices.sort_unstable();
        self.next = (self.next + count) % n.max(1);
        let mut moved = Vec::with_capacity(count);
        for index in &indices {
            let b = self.boxes[*index as usize];
            let by = match motion {
                Motion::Drift => Random::new(u64::from(*index)).direction().map(|x| STEP * x),
                Motion::Jitter => self.random.direction().map(|x| STEP * x),
                Motion::Teleport | Motion::Spawn => {
                    let there = self.boxes[self.random.below(n as u64) as usize].min;
                    let random = &mut self.random;
                    std::array::from_fn(|axis| there[axis] - b.min[axis] + random.range(-0.4, 0.4))
                }
            };
            let by = |x: [f32; 3]| std::array::from_fn(|axis| x[axis] + by[axis]);
            moved.push(Aabb { min: by(b.min), max: by(b.max) });
        }
        for (index, b) in indices.iter().zip(&moved) {
            self.boxes[*index as usize] = *b;
        }
        (indices, moved)
    }
}
