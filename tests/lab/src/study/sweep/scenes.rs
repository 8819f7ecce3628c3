//! Scenes that a sweep may be made for: lines, planes, long worlds, and boxes that no cubic cell suits.

use std::fmt;

use pairmask_core::Aabb;
use pairmaskd::scene::{Scene, SceneName};

use crate::stress::scenes::Rng;

/// A scene of the sweep study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SweepScene {
    /// One of the benches' scenes.
    Named(SceneName),
    /// Unit boxes on a line, one beside the other, each of which overlaps its next.
    Line,
    /// Unit boxes on a plane, as far apart as on average one overlaps another.
    Sheet,
    /// Unit boxes in a corridor of 10 by 10.
    Corridor,
    /// Boxes of 100 by 1 by 1, all along one axis, in a cube.
    Planks,
    /// Needles along each axis in turn in one place: as long as the scene is wide, and thin.
    Needles,
    /// Plates across one axis in one place, with gaps.
    Plates,
}

impl SweepScene {
    /// All of them: first those of the anchors.
    pub const ALL: [Self; 12] = [
        Self::Named(SceneName::Uniform),
        Self::Named(SceneName::Mixed),
        Self::Named(SceneName::Pile),
        Self::Named(SceneName::Plane),
        Self::Named(SceneName::Rods),
        Self::Named(SceneName::OneCell),
        Self::Line,
        Self::Sheet,
        Self::Corridor,
        Self::Planks,
        Self::Needles,
        Self::Plates,
    ];

    /// The boxes.
    pub fn boxes(self, n: u32) -> Vec<Aabb> {
        let mut random = Rng::new(17);
        let count = f64::from(n.max(1));
        // A scene of unit boxes with about one pair a box: n/2 pairs are met with probability (2/side)^axes.
        let side = |axes: f64| (2.0 * count.powf(1.0 / axes)) as f32;
        // As long as the scene; so thin that a box overlaps about one other.
        let thin = |power: f64| (0.5 * count.powf(-power)) as f32;
        let mut solid = |scale: [f32; 3], size: [f32; 3]| {
            let point = random.point();
            let min: [f32; 3] = std::array::from_fn(|axis| scale[axis] * point[axis]);
            Aabb { min, max: std::array::from_fn(|axis| min[axis] + size[axis]) }
        };
        let across = |i: u32, along: f32, other: f32| {
            std::array::from_fn(|axis| if axis == i as usize % 3 { along } else { other })
        };
        match self {
            Self::Named(name) => Scene::new(name, n as usize, 1).boxes().to_vec(),
            Self::Line => (0..n).map(|_| solid([side(1.0), 0.0, 0.0], [1.0; 3])).collect(),
            Self::Sheet => (0..n).map(|_| solid([side(2.0), side(2.0), 0.0], [1.0; 3])).collect(),
            Self::Corridor => {
                let length = (8.0 * count / 100.0) as f32;
                (0..n).map(|_| solid([length, 10.0, 10.0], [1.0; 3])).collect()
            }
            Self::Planks => {
                let side = side(3.0) * 100f32.powf(1.0 / 3.0);
                (0..n).map(|_| solid([side; 3], [100.0, 1.0, 1.0])).collect()
            }
            Self::Needles => {
                (0..n).map(|i| solid(across(i, 0.0, 1.0), across(i, 1.0, thin(1.0)))).collect()
            }
            Self::Plates => {
                // Plates across two axes always meet: all across one, with gaps.
                (0..n).map(|_| solid([0.0, 0.0, 1.0], [1.0, 1.0, thin(1.0)])).collect()
            }
        }
    }
}

impl fmt::Display for SweepScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Named(name) => name.as_str(),
            Self::Line => "line",
            Self::Sheet => "sheet",
            Self::Corridor => "corridor",
            Self::Planks => "planks",
            Self::Needles => "needles",
            Self::Plates => "plates",
        })
    }
}
