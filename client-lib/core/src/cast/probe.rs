//! What a search needs of a ray or a sphere.

use std::cmp::Ordering;

use super::node::{Keys, Node};
use crate::aabb::Aabb;

/// Bounds in f32 are off by less than this share: four roundings, with room.
pub(super) const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

/// A valid question.
///
/// Its distances are f64 whose relative error is below [`ERROR`](super::exact::ERROR): those by which a search goes, not
/// those that are reported.
pub(super) trait Probe: Copy {
    /// Keys of 16 boxes that may be hit within a limit. Limits, and what keys are made of, are of one unit.
    fn keys(&self, boxes: &Node, limit: f32, keys: &mut Keys);

    /// The limit of all that may be hit.
    fn most(&self) -> f32;

    /// The limit within which all boxes are that are no farther than a distance.
    fn limit_of(&self, distance: f64) -> f32;

    /// The distance of a box, if it is hit: exactly. The box is valid, or [`NOTHING`](super::node::NOTHING), which is never
    /// hit.
    fn measure(&self, b: &Aabb) -> Option<f64>;

    /// Compares the exact distances of two boxes that are hit.
    fn compare(&self, a: &Aabb, b: &Aabb) -> Ordering;

    /// A distance as it is reported.
    fn reported(&self, distance: f64) -> f32;
}

/// A number in f32 that is not below one in f64, as a limit.
pub(super) fn limit_above(x: f64) -> f32 {
    // Subnormal products of bounds are off by less than the smallest normal number.
    (x as f32).next_up() * (1.0 + ROUNDING) + f32::MIN_POSITIVE
}
