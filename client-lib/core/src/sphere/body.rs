//! Spheres as what holds points, by which crowds of them are found.

use super::Sphere;
use crate::aabb::Aabb;
use crate::engine::Body;

impl Body for Sphere {
    /// Of the cube within; not exactly, since each point is tested again.
    fn inner(&self) -> Aabb {
        let half = self.radius * 0.577;
        let face = |x: f32| x.clamp(-f32::MAX, f32::MAX);
        let [min, max] = [-half, half].map(|half| self.center.map(|x| face(x + half)));
        Aabb { min, max }
    }

    fn holds(&self, point: [f32; 3]) -> bool {
        self.overlaps(&Self { center: point, radius: 0.0 })
    }

    fn meets(&self, other: &Self) -> bool {
        self.overlaps(other)
    }

    /// A test of two takes ten times as long as one of boxes.
    const SAMPLED: usize = 1_024;
}
