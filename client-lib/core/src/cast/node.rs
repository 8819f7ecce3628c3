//! Sixteen boxes side by side.

use crate::aabb::Aabb;
use crate::fetch::ask_for;

/// Boxes of a leaf, and groups of a group.
pub(super) const FAN_OUT: usize = 16;

/// A number of each of 16 boxes.
pub(super) type Lanes = [f32; FAN_OUT];

/// What is known of each of 16 boxes or groups: [`MISSED`], or below which distance it is not, as the bits of a number
/// from 0 on, which sort like it, with the lane in place of the last four.
pub(super) type Keys = [i32; FAN_OUT];

/// The key of what is not hit within the limit.
pub(super) const MISSED: i32 = i32::MAX;

const LANE_BITS: i32 = FAN_OUT as i32 - 1;

/// The key of a lane that is not nearer than `lower`, which is not negative.
#[inline(always)]
pub(super) fn key(lower: f32, lane: usize) -> i32 {
    lower.to_bits() as i32 & !LANE_BITS | lane as i32
}

/// The largest key that may be within a limit, which is not negative.
#[inline(always)]
pub(super) fn key_limit(limit: f32) -> i32 {
    limit.to_bits() as i32 | LANE_BITS
}

/// Takes the nearest of 16 away: its key.
#[inline(always)]
pub(super) fn take_nearest(keys: &mut Keys) -> (i32, usize) {
    let mut nearest = MISSED;
    for key in keys.iter() {
        nearest = nearest.min(*key);
    }
    // All lanes are written, so that they can be read together at once.
    for key in keys.iter_mut() {
        *key = if *key == nearest { MISSED } else { *key };
    }
    (nearest, (nearest & LANE_BITS) as usize)
}

/// In place of a box that nothing hits: no distance to it is finite.
pub(super) const NOTHING: Aabb = Aabb { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

/// Boxes by coordinate: six cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Node {
    pub min: [Lanes; 3],
    pub max: [Lanes; 3],
}

impl Node {
    pub const NOTHING: Self =
        Self { min: [[f32::INFINITY; FAN_OUT]; 3], max: [[f32::NEG_INFINITY; FAN_OUT]; 3] };

    #[inline]
    pub fn set(&mut self, lane: usize, b: &Aabb) {
        for axis in 0..3 {
            self.min[axis][lane] = b.min[axis];
            self.max[axis][lane] = b.max[axis];
        }
    }

    #[inline]
    pub fn get(&self, lane: usize) -> Aabb {
        Aabb {
            min: std::array::from_fn(|axis| self.min[axis][lane]),
            max: std::array::from_fn(|axis| self.max[axis][lane]),
        }
    }

    /// Asks for all of it, of which a test reads each line.
    #[inline(always)]
    pub fn ask_for(&self) {
        for axis in 0..3 {
            ask_for(&self.min, axis);
            ask_for(&self.max, axis);
        }
    }

    /// A box around all.
    pub fn bounds(&self) -> Aabb {
        let mut bounds = NOTHING;
        for axis in 0..3 {
            for lane in 0..FAN_OUT {
                let (min, max) = (self.min[axis][lane], self.max[axis][lane]);
                bounds.min[axis] = if min < bounds.min[axis] { min } else { bounds.min[axis] };
                bounds.max[axis] = if max > bounds.max[axis] { max } else { bounds.max[axis] };
            }
        }
        bounds
    }
}

/// A leaf: boxes and their indices, which are beyond all where there is no box.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Leaf {
    pub boxes: Node,
    pub indices: [u32; FAN_OUT],
}

impl Leaf {
    pub const NOTHING: Self = Self { boxes: Node::NOTHING, indices: [u32::MAX; FAN_OUT] };

    /// Asks for all of it.
    #[inline(always)]
    pub fn ask_for(&self) {
        self.boxes.ask_for();
        ask_for(&self.indices, 0);
    }
}
