//! The world: boxes that fall, a floor, and four walls.

use glam::Vec3;
use pairmask::Aabb;

/// One frame, s.
const TIME_STEP: f32 = 1.0 / 60.0;
/// m/s².
const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);
/// Half edge of the floor over the square root of the number of boxes, m.
const ROOM_PER_BOX: f32 = 0.4;
/// Share of an overlap that is removed in a frame. Removing all of it at once makes heaps tremble.
const PUSH_SHARE: f32 = 0.4;

/// Boxes of half edge 0.4 m with a velocity each.
pub struct World {
    centres: Vec<Vec3>,
    velocities: Vec<Vec3>,
    room: f32,
    /// The deepest overlap of the last frame, m.
    overlap: f32,
}

/// Half edges of every box, m.
const HALF: Vec3 = Vec3::splat(0.4);

impl World {
    /// `n` boxes in the air.
    pub fn new(n: u32) -> Self {
        let room = ROOM_PER_BOX * (n as f32).sqrt() + 1.0;
        // Multiples of the golden ratio and of its square: evenly spread, and the same in every
        // run.
        let spread = |i: u32, step: f32| (i as f32 * step).fract() * 2.0 - 1.0;
        let centre = |i| {
            let side = room - HALF.x;
            Vec3::new(
                side * spread(i, 0.618_034),
                1.0 + 0.05 * i as f32,
                side * spread(i, 0.754_877),
            )
        };
        let centres = (0..n).map(centre).collect();
        Self { centres, velocities: vec![Vec3::ZERO; n as usize], room, overlap: 0.0 }
    }

    /// Number of boxes.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// Moves every box for one frame.
    pub fn fall(&mut self) {
        let low = Vec3::new(-self.room, 0.0, -self.room) + HALF;
        let high = Vec3::new(self.room, f32::INFINITY, self.room) - HALF;
        for (centre, velocity) in self.centres.iter_mut().zip(&mut self.velocities) {
            *velocity += GRAVITY * TIME_STEP;
            let wanted = *centre + *velocity * TIME_STEP;
            *centre = wanted.clamp(low, high);
            // A box that hits the floor or a wall loses its speed on that axis.
            *velocity = Vec3::select(centre.cmpeq(wanted), *velocity, Vec3::ZERO);
        }
    }

    /// Writes the boxes of this frame into `boxes`.
    pub fn write_boxes(&self, boxes: &mut [Aabb]) {
        for (slot, centre) in boxes.iter_mut().zip(&self.centres) {
            *slot = Aabb::from_center_half(*centre, HALF);
        }
    }

    /// Pushes each overlapping pair apart along the axis on which it overlaps least.
    pub fn push_apart(&mut self, pairs: &[(u32, u32)]) {
        self.overlap = 0.0;
        for (a, b) in pairs {
            let (a, b) = (*a as usize, *b as usize);
            let apart = self.centres[b] - self.centres[a];
            let overlap = 2.0 * HALF - apart.abs();
            let axis = overlap.min_position();
            self.overlap = self.overlap.max(overlap[axis]);
            let direction = if apart[axis] < 0.0 { -1.0 } else { 1.0 };
            // An earlier pair of this frame may have parted the boxes: the push is then 0.
            let push = 0.5 * PUSH_SHARE * overlap[axis].max(0.0) * direction;
            self.centres[a][axis] -= push;
            self.centres[b][axis] += push;
            // Boxes that approach each other get the same speed.
            let (va, vb) = (self.velocities[a][axis], self.velocities[b][axis]);
            if (va - vb) * direction > 0.0 {
                self.velocities[a][axis] = 0.5 * (va + vb);
                self.velocities[b][axis] = 0.5 * (va + vb);
            }
        }
    }

    /// Centre of the highest box, m.
    pub fn height(&self) -> f32 {
        self.centres.iter().map(|centre| centre.y).fold(0.0, f32::max)
    }

    /// The deepest overlap of the last frame, m.
    pub const fn overlap(&self) -> f32 {
        self.overlap
    }
}
