//! Worst cases: scenes on which broad phases become much slower.

use pairmask_core::Aabb;

use super::{Random, Scene, Walls, around, spread};

/// How far off the outliers of `one-cell` are: the scene's side times this.
const OUTLIER_SIDES: f32 = 4_000.0;

/// A uniform scene and up to eight far boxes, one for each corner of a huge cube.
pub(super) fn one_cell(n: usize, random: &mut Random) -> Scene {
    let mut scene = spread::uniform(n, random);
    let outliers = 8.min(n / 2);
    let far = OUTLIER_SIDES * (4.0 * n as f32).cbrt();
    for (corner, b) in scene.boxes[n - outliers..].iter_mut().enumerate() {
        let side = |bit: usize| if corner >> bit & 1 == 0 { -far } else { far };
        *b = around([side(0), side(1), side(2)], [1.0; 3]);
    }
    // The outliers do not move: walls would bring them back to the scene.
    for v in &mut scene.velocities[n - outliers..] {
        *v = [0.0; 3];
    }
    scene
}

/// Length of a rod against its width.
const ROD_LENGTH: f32 = 40.0;

/// Rods of width 1 along x, y or z.
///
/// Parallel rods overlap in 2 · 2 · 80 = 320 units of volume, crossed ones in 2 · 41 · 41 = 3,362;
/// one third are parallel: 2,348 on average. One pair a box needs V = 1,174 n.
pub(super) fn rods(n: usize, random: &mut Random) -> Scene {
    let side = (1_174.0 * n as f32).cbrt();
    let boxes = (0..n)
        .map(|_| {
            let mut edges = [1.0; 3];
            edges[random.below(3) as usize] = ROD_LENGTH;
            around([(); 3].map(|()| random.range(0.0, side)), edges)
        })
        .collect();
    Scene::drifting(boxes, Walls::Scene { low: [0.0; 3], high: [side; 3] }, random)
}

/// Dust of the density of `uniform`; one box in a thousand is a tenth of the scene wide (at most 16
/// of them), one is an infinite ground, and one covers everything.
pub(super) fn giants(n: usize, random: &mut Random) -> Scene {
    let mut scene = spread::uniform(n, random);
    let side = (4.0 * n as f32).cbrt();
    let giant_count = (n / 1_000).min(16);
    for _ in 0..giant_count {
        let i = random.below(n as u64) as usize;
        let centre = [(); 3].map(|()| random.range(0.0, side));
        scene.boxes[i] = around(centre, [0.1 * side; 3]);
    }
    let infinite = f32::INFINITY;
    if n >= 64 {
        scene.boxes[n / 3] = Aabb { min: [-infinite; 3], max: [infinite, infinite, 0.0] };
        scene.boxes[n / 2] = Aabb { min: [-infinite; 3], max: [infinite; 3] };
        scene.velocities[n / 3] = [0.0; 3];
        scene.velocities[n / 2] = [0.0; 3];
    }
    scene
}

/// Offsets at which a float's step is 1/16, 1/64 and 1/32 of a box.
const FAR_ORIGIN: [f32; 3] = [1.0e6, -2.0e5, 5.0e5];

/// A uniform scene far from the origin. Steps below a float's step do not move a box on that axis.
pub(super) fn far(n: usize, random: &mut Random) -> Scene {
    let mut scene = spread::uniform(n, random);
    let side = (4.0 * n as f32).cbrt();
    for b in &mut scene.boxes {
        for axis in 0..3 {
            b.min[axis] += FAR_ORIGIN[axis];
            b.max[axis] += FAR_ORIGIN[axis];
        }
    }
    scene.walls = Walls::Scene { low: FAR_ORIGIN, high: FAR_ORIGIN.map(|x| x + side) };
    scene
}

/// The unit box, n times, moving as one.
pub(super) fn identical(n: usize, random: &mut Random) -> Scene {
    let velocity = random.direction().map(|d| d * super::STEP_SHARE);
    let walls = Walls::Scene { low: [0.0; 3], high: [10.0; 3] };
    Scene::moving(vec![around([5.0; 3], [1.0; 3]); n], walls, |_| velocity)
}
