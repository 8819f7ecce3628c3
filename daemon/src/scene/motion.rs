//! How boxes move from frame to frame: in place, without allocation.

use pairmask_core::Aabb;

/// Share of a box's size that it moves in a frame.
///
/// The size is the mean edge. 2 % is the motion of the anchors: at 60 frames a second a box
/// crosses its own length in under a second.
pub const STEP_SHARE: f32 = 0.02;

/// The walls at which boxes turn round.
#[derive(Clone, Debug)]
pub enum Walls {
    /// Every box stays between the same two corners (of its centre).
    Scene {
        /// Lowest centre.
        low: [f32; 3],
        /// Highest centre.
        high: [f32; 3],
    },
    /// Every box stays within `radius` of its own first centre on each axis, so that the scene
    /// keeps its shape, for instance a heap.
    Cage {
        /// First centres.
        home: Vec<[f32; 3]>,
        /// Half edge of the cage.
        radius: f32,
    },
    /// Boxes reflect at the sides; one that falls below the floor comes back at the top.
    Falling {
        /// Lowest centre.
        low: [f32; 3],
        /// Highest centre.
        high: [f32; 3],
    },
}

/// Moves every box by its velocity, turning it round where it would leave its walls.
///
/// Infinite coordinates stay as they are. Boxes keep their size up to rounding.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_turn_at_walls_and_infinities_stay() {
        let mut boxes =
            [Aabb::from([0.0, 0.0, f32::NEG_INFINITY, 1.0, 1.0, 0.0]), Aabb::from([8.9; 6])];
        let mut velocities = [[-0.2, 0.2, 0.0], [0.2; 3]];
        let walls = Walls::Scene { low: [0.0; 3], high: [9.0; 3] };
        for _ in 0..100 {
            advance(&mut boxes, &mut velocities, &walls);
            for axis in 0..2 {
                let centre = 0.5 * (boxes[0].min[axis] + boxes[0].max[axis]);
                assert!((-0.2..=9.2).contains(&centre), "axis {axis}: {centre}");
            }
            assert_eq!((boxes[0].min[2], boxes[0].max[2]), (f32::NEG_INFINITY, 0.0));
        }
    }

    #[test]
    fn fallen_boxes_come_back_at_the_top() {
        let mut boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])];
        let walls = Walls::Falling { low: [0.0; 3], high: [9.0; 3] };
        advance(&mut boxes, &mut [[0.0, 0.0, -1.0]], &walls);
        assert_eq!(boxes[0].min[2], 8.0);
    }
}
