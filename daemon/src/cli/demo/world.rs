//! Falling boxes: just enough physics to need the pairs.
//!
//! In every frame gravity moves the boxes, the daemon finds the overlapping pairs, and each pair is
//! pushed apart along the axis on which it overlaps least. Boxes fall again from the top after a
//! while, so that there is always motion.

use pairmask_core::Aabb;

use crate::scene::Random;

/// Time of the world between two frames, s. Frames run as fast as they can.
const TIME_STEP: f32 = 1.0 / 120.0;
/// Downwards, m/s².
const GRAVITY: f32 = 9.81;
/// Share of the speed that is left after a bounce. With a higher one boxes never come to rest.
const BOUNCE: f32 = 0.2;
/// Share of an overlap that is removed in a frame. Removing all of it at once makes heaps tremble.
const PUSH_SHARE: f32 = 0.4;
/// Frames between two falls of a box: about eight seconds of the world's time.
const LIFE_FRAMES: usize = 1000;

/// Boxes in a room with a floor and four walls.
#[derive(Clone, Debug)]
pub struct World {
    centres: Vec<[f32; 3]>,
    velocities: Vec<[f32; 3]>,
    halves: Vec<[f32; 3]>,
    /// Half edge of the floor.
    room: f32,
    /// Height from which boxes fall.
    top: f32,
    frame: usize,
    random: Random,
}

impl World {
    /// `n` boxes in the air. The same n gives the same world.
    pub fn new(n: u32) -> Self {
        let mut random = Random::new(u64::from(n));
        // About four layers when all lie.
        let room = (n as f32).sqrt() * 0.25 + 1.0;
        let top = 4.0 + n as f32 / (room * room);
        let halves = (0..n).map(|_| std::array::from_fn(|_| random.range(0.2, 0.5)));
        let halves: Vec<[f32; 3]> = halves.collect();
        let centres = (0..n).map(|_| {
            let [x, z] = std::array::from_fn(|_| random.range(-room, room));
            [x, random.range(0.5, top), z]
        });
        let centres = centres.collect();
        Self {
            centres,
            velocities: vec![[0.0; 3]; n as usize],
            halves,
            room,
            top,
            frame: 0,
            random,
        }
    }

    pub fn len(&self) -> usize {
        self.centres.len()
    }

    pub fn write_boxes(&self, boxes: &mut [Aabb]) {
        for ((slot, centre), half) in boxes.iter_mut().zip(&self.centres).zip(&self.halves) {
            *slot = Aabb::from_center_half(*centre, *half);
        }
    }

    /// Pushes overlapping pairs apart and advances the world by one frame.
    pub fn step(&mut self, pairs: impl Iterator<Item = [u32; 2]>) {
        for [a, b] in pairs {
            self.push_apart(a as usize, b as usize);
        }
        self.drop_the_oldest();
        for i in 0..self.len() {
            self.velocities[i][1] -= GRAVITY * TIME_STEP;
            for axis in 0..3 {
                self.centres[i][axis] += self.velocities[i][axis] * TIME_STEP;
            }
            self.keep_in_room(i);
        }
        self.frame += 1;
    }

    /// Resolves the collision of two boxes of equal mass on the axis of their smallest overlap.
    fn push_apart(&mut self, a: usize, b: usize) {
        let (axis, overlap) = self.least_overlap(a, b);
        if overlap <= 0.0 {
            // An earlier pair of this frame has moved the boxes apart.
            return;
        }
        let is_below = self.centres[b][axis] < self.centres[a][axis];
        let direction = if is_below { -1.0 } else { 1.0 };
        let push = 0.5 * PUSH_SHARE * overlap * direction;
        self.centres[a][axis] -= push;
        self.centres[b][axis] += push;
        let closing = (self.velocities[a][axis] - self.velocities[b][axis]) * direction;
        if closing > 0.0 {
            let change = 0.5 * (1.0 + BOUNCE) * closing * direction;
            self.velocities[a][axis] -= change;
            self.velocities[b][axis] += change;
        }
    }

    /// The axis on which two boxes overlap least, and by how much; below 0 where they are apart.
    fn least_overlap(&self, a: usize, b: usize) -> (usize, f32) {
        let overlap = |axis: usize| {
            let apart = self.centres[b][axis] - self.centres[a][axis];
            (axis, self.halves[a][axis] + self.halves[b][axis] - apart.abs())
        };
        let [x, y, z] = [0, 1, 2].map(overlap);
        [y, z].into_iter().fold(x, |least, other| if other.1 < least.1 { other } else { least })
    }

    fn keep_in_room(&mut self, i: usize) {
        let (low, high) = ([-self.room, 0.0, -self.room], [self.room, f32::INFINITY, self.room]);
        for axis in 0..3 {
            let (at, half) = (self.centres[i][axis], self.halves[i][axis]);
            let held = at.max(low[axis] + half).min(high[axis] - half);
            if held != at {
                self.centres[i][axis] = held;
                self.velocities[i][axis] *= -BOUNCE;
            }
        }
    }

    /// Drops boxes again in turn, each after [`LIFE_FRAMES`].
    fn drop_the_oldest(&mut self) {
        let n = self.len();
        let turn = self.frame % LIFE_FRAMES;
        for i in turn * n / LIFE_FRAMES..(turn + 1) * n / LIFE_FRAMES {
            let [x, z] = std::array::from_fn(|_| self.random.range(-self.room, self.room));
            self.centres[i] = [x, self.top, z];
            self.velocities[i] = [0.0; 3];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_pairs(world: &World) -> Vec<[u32; 2]> {
        let mut boxes = vec![Aabb::default(); world.len()];
        world.write_boxes(&mut boxes);
        let mut pairs = Vec::new();
        for a in 0..boxes.len() {
            for b in a + 1..boxes.len() {
                if boxes[a].overlaps(&boxes[b]) {
                    pairs.push([a as u32, b as u32]);
                }
            }
        }
        pairs
    }

    #[test]
    fn the_pairs_hold_boxes_apart() {
        let overlap = |use_pairs: bool| {
            let mut world = World::new(60);
            for _ in 0..LIFE_FRAMES / 2 {
                let pairs = if use_pairs { all_pairs(&world) } else { Vec::new() };
                world.step(pairs.into_iter());
            }
            all_pairs(&world)
                .iter()
                .map(|[a, b]| world.least_overlap(*a as usize, *b as usize).1)
                .sum::<f32>()
        };
        let (with, without) = (overlap(true), overlap(false));
        assert!(with < 0.2 * without, "{with} m overlap with pairs, {without} m without");
    }
}
