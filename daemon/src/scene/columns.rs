//! The papers' scenes: columns of objects that fall on a plane.
//!
//! Avril et al. 2009 and 2014 let cubes, balls, skittles, tori and letters fall. The broad phase
//! gets only the box around an object, so each kind is a box of its proportions turned at random.
//! The lower half of a column has landed and is packed closely; the upper half still falls.

use super::{Random, STEP_SHARE, Scene, Walls, around, mean_edge};

/// Objects in a column.
const COLUMN_HEIGHT: usize = 32;
/// Distance between columns, in units of the objects' nominal size 1.
const COLUMN_STEP: f32 = 1.3;
/// Mean distance of objects that have landed, and of those that fall.
const LANDED_STEP: f32 = 0.75;
/// See [`LANDED_STEP`].
const FALLING_STEP: f32 = 1.8;

/// `n` objects in square columns, with edges from `object`.
pub(super) fn falling(
    n: usize,
    random: &mut Random,
    mut object: impl FnMut(&mut Random) -> [f32; 3],
) -> Scene {
    let column_count = n.div_ceil(COLUMN_HEIGHT).max(1);
    let side = (column_count as f32).sqrt().ceil() as usize;
    let landed = COLUMN_HEIGHT / 2;
    let top = landed as f32 * (LANDED_STEP + FALLING_STEP);
    let boxes: Vec<_> = (0..n)
        .map(|i| {
            // Object order runs across the columns first, as if dropped layer by layer.
            let (column, level) = (i % column_count, i / column_count);
            let sway = 0.3;
            let x = (column % side) as f32 * COLUMN_STEP + random.range(-sway, sway);
            let y = (column / side) as f32 * COLUMN_STEP + random.range(-sway, sway);
            let fallen = level.min(landed) as f32 * LANDED_STEP;
            let in_air = level.saturating_sub(landed) as f32 * FALLING_STEP;
            let z = fallen + in_air + random.range(-0.2, 0.2);
            around([x, y, z], object(random))
        })
        .collect();
    let edge = side as f32 * COLUMN_STEP;
    let walls = Walls::Falling { low: [-1.0, -1.0, -0.2], high: [edge + 1.0, edge + 1.0, top] };
    let mut landing = 0usize;
    Scene::moving(boxes, walls, |b| {
        let step = STEP_SHARE * mean_edge(b);
        let level = landing / column_count;
        landing += 1;
        let [x, y, z] = random.direction();
        // Falling objects move down together; landed ones are jostled.
        let direction = if level < landed { [x, y, z.abs() * 0.1] } else { [0.0, 0.0, -1.0] };
        direction.map(|d| d * step)
    })
}

/// Half extents of a turned box, on each world axis: Σ |R| · half (the tight box around it).
fn turned(edges: [f32; 3], random: &mut Random) -> [f32; 3] {
    let x = random.direction();
    let d = random.direction();
    // Gram-Schmidt. The two directions are parallel with probability 0. Where they are nearly
    // parallel, the box is a little off its proportions, which no test relies on.
    let dot = x[0] * d[0] + x[1] * d[1] + x[2] * d[2];
    let y = std::array::from_fn::<f32, 3, _>(|i| d[i] - dot * x[i]);
    let length = (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]).sqrt().max(1e-3);
    let y = y.map(|c| c / length);
    let z = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    std::array::from_fn(|i| edges[0] * x[i].abs() + edges[1] * y[i].abs() + edges[2] * z[i].abs())
}

/// A turned unit cube: edges of its box 1 to √3.
pub(super) fn cube(random: &mut Random) -> [f32; 3] {
    turned([0.8; 3], random)
}

/// A ball: every box is the same cube.
pub(super) fn ball(_: &mut Random) -> [f32; 3] {
    [1.0; 3]
}

/// A skittle: three times as tall as wide.
pub(super) fn skittle(random: &mut Random) -> [f32; 3] {
    turned([0.4, 0.4, 1.2], random)
}

/// A torus: a flat disc.
pub(super) fn torus(random: &mut Random) -> [f32; 3] {
    turned([1.0, 1.0, 0.3], random)
}

/// A letter: thin, of any width and height, and of sizes 1 to 3.
pub(super) fn letter(random: &mut Random) -> [f32; 3] {
    let size = random.log_range(0.5, 1.5);
    let edges = [size * random.range(0.3, 1.0), 0.2 * size, size];
    turned(edges, random)
}
