//! The world: boxes that fall, a floor, and four walls.

use std::collections::BTreeSet;

use glam::Vec3;
use pairmask::Aabb;

use crate::contacts::{Contacts, Pair};

/// One frame, s.
const TIME_STEP: f32 = 1.0 / 60.0;
/// m/s².
const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);
/// Half edges of every box that falls, m.
const HALF: Vec3 = Vec3::splat(0.4);
/// Half edge of the floor over the square root of the number of boxes, m.
const ROOM_PER_BOX: f32 = 0.4;
/// Thickness of floor and walls, m. A box that falls through it within a frame is lost: 600 m/s.
const THICKNESS: f32 = 10.0;
/// Share of an overlap that is removed in a frame. Removing all of it at once makes heaps tremble.
const PUSH_SHARE: f32 = 0.4;
/// A box rests while it stays this near to one place, m.
const REST_DISTANCE: f32 = 0.005;
/// A box that has rested for so many frames sleeps.
const FRAMES_TO_SLEEP: u32 = 30;

/// Boxes by index: those that fall, then floor and walls.
pub struct World {
    centres: Vec<Vec3>,
    halves: Vec<Vec3>,
    velocities: Vec<Vec3>,
    /// Where a box began to rest, and for how many frames it has.
    rests: Vec<(Vec3, u32)>,
    /// How many fall.
    falling: usize,
    moved: Vec<u32>,
    moved_boxes: Vec<Aabb>,
    /// The deepest overlap of the last frame, m.
    overlap: f32,
}

impl World {
    /// `n` boxes in the air.
    pub fn new(n: u32) -> Self {
        let room = ROOM_PER_BOX * (n as f32).sqrt() + 1.0;
        // Multiples of the golden ratio and of its square: evenly spread, and the same in every
        // run.
        let spread = |i: u32, step: f32| (i as f32 * step).fract() * 2.0 - 1.0;
        let height = |i: u32| 1.0 + 0.05 * i as f32;
        let centre = |i| {
            let side = room - HALF.x;
            Vec3::new(side * spread(i, 0.618_034), height(i), side * spread(i, 0.754_877))
        };
        let mut centres: Vec<Vec3> = (0..n).map(centre).collect();
        let mut halves = vec![HALF; n as usize];

        // Four walls as high as the highest box, around a floor that ends below them.
        let (out, up) = (room + THICKNESS, height(n) + THICKNESS);
        let slabs = [
            ([-out, -THICKNESS, -out], [out, 0.0, out]),
            ([-out, -THICKNESS, -out], [-room, up, out]),
            ([room, -THICKNESS, -out], [out, up, out]),
            ([-out, -THICKNESS, -out], [out, up, -room]),
            ([-out, -THICKNESS, room], [out, up, out]),
        ];
        for (min, max) in slabs.map(|(min, max)| (Vec3::from(min), Vec3::from(max))) {
            centres.push(0.5 * (min + max));
            halves.push(0.5 * (max - min));
        }
        Self {
            velocities: vec![Vec3::ZERO; centres.len()],
            rests: centres.iter().map(|centre| (*centre, 0)).collect(),
            centres,
            halves,
            falling: n as usize,
            moved: Vec::new(),
            moved_boxes: Vec::new(),
            overlap: 0.0,
        }
    }

    /// All boxes.
    pub fn boxes(&self) -> Vec<Aabb> {
        (0..self.centres.len()).map(|i| self.box_at(i)).collect()
    }

    /// Indices of floor and walls, which never move.
    pub fn statics(&self) -> std::ops::Range<u32> {
        self.falling as u32..self.centres.len() as u32
    }

    fn box_at(&self, i: usize) -> Aabb {
        Aabb::from_center_half(self.centres[i], self.halves[i])
    }

    /// Whether a box neither falls nor is pushed: it sleeps, or is static.
    fn is_still(&self, i: usize) -> bool {
        i >= self.falling || self.rests[i].1 > FRAMES_TO_SLEEP
    }

    /// Moves every box that is awake for one frame.
    pub fn fall(&mut self) {
        self.moved.clear();
        self.moved_boxes.clear();
        for i in 0..self.falling {
            if self.is_still(i) {
                continue;
            }
            let (anchor, frames) = &mut self.rests[i];
            if self.centres[i].distance(*anchor) > REST_DISTANCE {
                (*anchor, *frames) = (self.centres[i], 0);
            }
            *frames += 1;
            if *frames > FRAMES_TO_SLEEP {
                // It sleeps from now on, where the last push left it.
                self.velocities[i] = Vec3::ZERO;
            } else {
                self.velocities[i] += GRAVITY * TIME_STEP;
                self.centres[i] += self.velocities[i] * TIME_STEP;
            }
            self.moved.push(i as u32);
            self.moved_boxes.push(self.box_at(i));
        }
    }

    /// Indices and boxes of those that may differ from the frame before: no others have to be sent.
    pub fn moved(&self) -> (&[u32], &[Aabb]) {
        (&self.moved, &self.moved_boxes)
    }

    /// The axis on which two boxes overlap least: they are pushed apart along it for as long as they
    /// touch.
    pub fn contact_axis(&self, pair: Pair) -> usize {
        let [a, b] = pair.map(|i| i as usize);
        let apart = self.centres[b] - self.centres[a];
        (self.halves[a] + self.halves[b] - apart.abs()).min_position()
    }

    /// Wakes boxes whose contacts have changed: they may have lost what they lie on.
    pub fn wake(&mut self, changed: &BTreeSet<Pair>) {
        for i in changed.iter().flatten() {
            self.rests[*i as usize].1 = 0;
        }
    }

    /// Pushes the boxes of each contact apart along its axis.
    pub fn push_apart(&mut self, contacts: &Contacts<usize>) {
        self.overlap = 0.0;
        for (pair, axis) in contacts.iter() {
            let ([a, b], axis) = (pair.map(|i| i as usize), *axis);
            let apart = self.centres[b][axis] - self.centres[a][axis];
            let overlap = self.halves[a][axis] + self.halves[b][axis] - apart.abs();
            self.overlap = self.overlap.max(overlap);
            // Shares of the push: still boxes get none.
            let (share_a, share_b) = match (self.is_still(a), self.is_still(b)) {
                (false, false) => (0.5, 0.5),
                (false, true) => (1.0, 0.0),
                (true, false) => (0.0, 1.0),
                (true, true) => continue,
            };
            let direction = if apart < 0.0 { -1.0 } else { 1.0 };
            // An earlier contact of this frame may have parted the boxes: the push is then 0.
            let push = PUSH_SHARE * overlap.max(0.0) * direction;
            self.centres[a][axis] -= share_a * push;
            self.centres[b][axis] += share_b * push;
            // Boxes that approach each other get the same speed.
            let (va, vb) = (self.velocities[a][axis], self.velocities[b][axis]);
            if (va - vb) * direction > 0.0 {
                let same = share_b * va + share_a * vb;
                self.velocities[a][axis] = same;
                self.velocities[b][axis] = same;
            }
        }
    }

    /// Centre of the highest box that falls, m.
    pub fn height(&self) -> f32 {
        self.centres[..self.falling].iter().map(|centre| centre.y).fold(0.0, f32::max)
    }

    /// The deepest overlap of the last frame, m.
    pub const fn overlap(&self) -> f32 {
        self.overlap
    }
}
