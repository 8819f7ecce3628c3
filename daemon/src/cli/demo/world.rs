//! The demo's world: boxes that fall on a platform, pile up by the pairs that were found, and come back at the top
//! where they fall over its edge.
//!
//! x is along the platform, y into the depth, z up. Motion is a game's least: gravity, then each pair pushed apart
//! along the axis on which it overlaps least.

use pairmask_core::Aabb;

use crate::scene::Random;

/// Time of a step, s: a frame of a game.
pub const STEP: f32 = 1.0 / 60.0;
const GRAVITY: f32 = 15.0;
/// Share of its speed that a box keeps in a second of air, which bounds how fast boxes fall.
const AIR: f32 = 0.7;
/// Share of its speed along the ground that a box keeps in a step on it.
const FRICTION: f32 = 0.95;
/// Largest share of gravity that pulls along the platform, to and fro in so many seconds: piles slide over its ends.
const SWAY: f32 = 0.35;
const SWAY_PERIOD: f32 = 5.0;
/// Share of an overlap that a step removes: with all of it, piles shake.
const PUSH: f32 = 0.4;
/// Overlap that is left, so that boxes at rest stay pairs.
const SLOP: f32 = 0.03;
/// Share of a push upwards that moves the upper box: those below carry others already.
const UPPER_SHARE: f32 = 0.8;
/// One box in so many is large.
const LARGE_ONE_IN: u64 = 40;
/// Width and height of the view over the depth of the world.
const WIDTH: f32 = 5.0;
const HEIGHT: f32 = 3.6;
/// Share of the view's width that the platform takes.
const PLATFORM: f32 = 0.8;
/// Volume of the world, up to three views high, for each box.
const VOLUME_A_BOX: f32 = 24.0;
/// How far boxes are dropped above the view, in views: they arrive one after another.
const DROPPED_FROM: f32 = 3.0;

/// What is seen from the side, in the world's units.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// x from minus to plus half of this.
    pub width: f32,
    /// z from 0, the platform, to this.
    pub height: f32,
    /// x of the platform's end; its other end is at minus this.
    pub platform: f32,
}

#[derive(Clone, Debug)]
pub struct World {
    boxes: Vec<Aabb>,
    halves: Vec<[f32; 3]>,
    centers: Vec<[f32; 3]>,
    speeds: Vec<[f32; 3]>,
    in_pairs: Vec<bool>,
    view: View,
    depth: f32,
    time: f32,
    random: Random,
}

impl World {
    pub fn new(n: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let depth = (VOLUME_A_BOX * n as f32 / (WIDTH * HEIGHT * DROPPED_FROM)).cbrt().max(1.5);
        let view = View {
            width: WIDTH * depth,
            height: HEIGHT * depth,
            platform: 0.5 * PLATFORM * WIDTH * depth,
        };
        let halves: Vec<[f32; 3]> = (0..n)
            .map(|_| {
                let is_large = random.below(LARGE_ONE_IN) == 0;
                let (low, high) = if is_large { (1.0, 1.6) } else { (0.3, 0.65) };
                [(); 3].map(|()| random.range(low, high).min(0.5 * depth))
            })
            .collect();
        let centers = (0..n)
            .map(|_| {
                let x = random.range(-0.5 * view.width, 0.5 * view.width);
                let y = random.range(0.0, depth);
                [x, y, random.range(0.0, DROPPED_FROM * view.height)]
            })
            .collect();
        let mut world = Self {
            boxes: vec![Aabb::default(); n],
            halves,
            centers,
            speeds: vec![[0.0; 3]; n],
            in_pairs: vec![false; n],
            view,
            depth,
            time: 0.0,
            random,
        };
        world.write_boxes();
        world
    }

    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    pub const fn view(&self) -> View {
        self.view
    }

    /// Boxes of a slice through the middle of the depth, and whether each is in a pair: all would hide each other.
    pub fn slice(&self) -> impl Iterator<Item = (&Aabb, bool)> {
        let middle = 0.5 * self.depth;
        let is_in = move |b: &Aabb| b.min[1] <= middle && middle <= b.max[1];
        self.boxes.iter().zip(self.in_pairs.iter().copied()).filter(move |(b, _)| is_in(b))
    }

    /// Moves every box by a step.
    pub fn step(&mut self) {
        self.time += STEP;
        let air = AIR.powf(STEP);
        let sway = SWAY * GRAVITY * (std::f32::consts::TAU * self.time / SWAY_PERIOD).sin();
        for i in 0..self.boxes.len() {
            if self.centers[i][2] < -0.2 * self.view.height {
                self.drop_again(i);
            }
            let (center, speed, half) = (&mut self.centers[i], &mut self.speeds[i], self.halves[i]);
            speed[0] += sway * STEP;
            speed[2] -= GRAVITY * STEP;
            for axis in 0..3 {
                speed[axis] *= air;
                center[axis] += speed[axis] * STEP;
            }
            center[1] = center[1].clamp(half[1], self.depth - half[1]);
            let is_over = center[0].abs() <= self.view.platform;
            // A box that is mostly below fell over the edge, and falls on.
            if is_over && center[2] < half[2] && center[2] > -half[2] {
                center[2] = half[2];
                *speed = [FRICTION * speed[0], FRICTION * speed[1], speed[2].max(0.0)];
            }
        }
        self.write_boxes();
    }

    /// Puts a box back to the spout, which goes to and fro above the view.
    fn drop_again(&mut self, i: usize) {
        let spout = 0.3 * self.view.width * (0.8 * self.time).sin();
        let spread = 0.08 * self.view.width;
        let x = spout + self.random.range(-spread, spread);
        let (y, z) = (self.random.range(0.0, self.depth), self.random.range(1.05, 1.5));
        self.centers[i] = [x, y, z * self.view.height];
        self.speeds[i] = [0.0, 0.0, -GRAVITY * 0.5];
    }

    fn write_boxes(&mut self) {
        for ((b, center), half) in self.boxes.iter_mut().zip(&self.centers).zip(&self.halves) {
            let corner = |sign: f32| std::array::from_fn(|axis| center[axis] + sign * half[axis]);
            *b = Aabb { min: corner(-1.0), max: corner(1.0) };
        }
    }

    /// Pushes the boxes of each pair apart: those that were found for [`World::boxes`].
    pub fn push_apart(&mut self, pairs: &[[u32; 2]]) {
        self.in_pairs.fill(false);
        for &[a, b] in pairs {
            let (a, b) = (a as usize, b as usize);
            self.in_pairs[a] = true;
            self.in_pairs[b] = true;
            self.push(a, b);
        }
    }

    fn push(&mut self, a: usize, b: usize) {
        let apart = |axis: usize| self.centers[b][axis] - self.centers[a][axis];
        let overlap = |axis: usize| self.halves[a][axis] + self.halves[b][axis] - apart(axis).abs();
        let axis = (0..3).min_by(|x, y| overlap(*x).total_cmp(&overlap(*y))).unwrap_or_default();
        let (depth, is_b_above) = (overlap(axis), apart(axis) >= 0.0);
        let (upper, lower) = if is_b_above { (b, a) } else { (a, b) };
        let share = if axis == 2 { UPPER_SHARE } else { 0.5 };
        let push = PUSH * (depth - SLOP).max(0.0);
        self.centers[upper][axis] += share * push;
        self.centers[lower][axis] -= (1.0 - share) * push;
        let (up, low) = (self.speeds[upper], self.speeds[lower]);
        // What comes closer goes on together.
        if up[axis] < low[axis] {
            let common = share * low[axis] + (1.0 - share) * up[axis];
            (self.speeds[upper][axis], self.speeds[lower][axis]) = (common, common);
        }
        if axis == 2 {
            for along in 0..2 {
                let rub = 0.1 * (up[along] - low[along]);
                self.speeds[upper][along] -= rub;
                self.speeds[lower][along] += rub;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::oracle::truth;

    use super::*;

    #[test]
    fn boxes_fall_pile_up_on_the_platform_and_come_back_at_the_top() {
        let mut world = World::new(300, 1);
        let view = world.view();
        let mut fell_over = 0;
        for _ in 0..600 {
            world.step();
            let pairs = truth(world.boxes()).pairs;
            world.push_apart(&pairs);
            fell_over += world.boxes().iter().filter(|b| b.max[2] < -0.1 * view.height).count();
        }
        assert!(world.boxes().iter().all(|b| b.min.iter().chain(&b.max).all(|x| x.is_finite())));
        let is_piled = |b: &&Aabb| b.min[2] > -0.1 && b.max[2] < 0.6 * view.height;
        let piled = world.boxes().iter().filter(is_piled).count();
        assert!(piled > 150 && fell_over > 0, "{piled} piled up, {fell_over} below");
        assert!(world.slice().any(|(_, is_in_pair)| is_in_pair), "none is in a pair");
    }

    #[test]
    fn the_same_seed_gives_the_same_world() {
        let run = |seed| {
            let mut world = World::new(50, seed);
            (0..90).for_each(|_| world.step());
            world.boxes().to_vec()
        };
        assert_eq!(run(7), run(7));
        assert_ne!(run(7), run(8));
    }
}
