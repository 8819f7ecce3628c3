//! The scenes: four of the anchors, and those of the papers, columns of objects that fall on a plane.
//!
//! Avril et al. 2009 and 2014 let cubes, balls, skittles, tori and letters fall. The broad phase
//! gets only the box around an object, so each kind is a box of its proportions turned at random.
//! The lower half of a column has landed and is packed closely; the upper half still falls.

use pairmask_core::Aabb;

use super::{Random, STEP_SHARE, Scene, Walls, around, mean_edge};

/// Centres in a cube, edges 0.8 to 1.2.
///
/// Two boxes overlap with probability (mean edge sum)³ / V = 8 / V, so n²/2 pairs of boxes give n
/// overlaps when V = 4n.
pub(super) fn uniform(n: usize, random: &mut Random) -> Scene {
    in_cube(n, 4.0, random, |random| [(); 3].map(|()| random.range(0.8, 1.2)))
}

/// Boxes anywhere in a cube of so much volume a box, with edges from `edges`.
fn in_cube(
    n: usize,
    volume: f32,
    random: &mut Random,
    edges: impl Fn(&mut Random) -> [f32; 3],
) -> Scene {
    let side = (volume * n as f32).cbrt();
    let boxes = (0..n)
        .map(|_| {
            let edges = edges(random);
            around([(); 3].map(|()| random.range(0.0, side)), edges)
        })
        .collect();
    Scene::drifting(boxes, Walls::Scene { low: [0.0; 3], high: [side; 3] }, random)
}

/// Cubes with log-uniform edges of three decades.
///
/// With moments `E[s] = 1.446`, `E[s²] = 7.238`, `E[s³] = 48.26` of the edge, `E[(s + t)³] = 159.3`; two
/// pairs a box need V = 159.3 n / 4.
pub(super) fn mixed(n: usize, random: &mut Random) -> Scene {
    in_cube(n, 39.83, random, |random| [random.log_range(0.01, 10.0); 3])
}

/// Lattice step of the pile in a layer, against edges of 0.9 to 1.1: neighbours mostly touch.
const BRICK_STEP: f32 = 0.91;
/// Lattice step of the pile from layer to layer.
const LAYER_STEP: f32 = 0.90;
/// Jitter of a brick on each axis; also how far it moves.
const BRICK_JITTER: f32 = 0.06;

/// A cone of radius 4 × height. Odd layers are shifted by half a brick on both axes, so that a
/// brick rests on four.
pub(super) fn pile(n: usize, random: &mut Random) -> Scene {
    let layer = LAYER_STEP;
    let brick_volume = BRICK_STEP * BRICK_STEP * layer;
    // Cone: n · brick = π r² h / 3 with r = 4 h. A little larger, then cut to n from below.
    let height =
        (1.02 * n as f32 * brick_volume * 3.0 / (16.0 * std::f32::consts::PI)).cbrt() + 2.0 * layer;
    let mut homes = Vec::with_capacity(n + n / 4);
    for level in 0_i32.. {
        let z = level as f32 * layer;
        if homes.len() >= n || z > height.max(layer) + layer * n as f32 {
            break;
        }
        let radius = (4.0 * (height - z)).max(BRICK_STEP);
        let shift = if level % 2 == 0 { 0.0 } else { 0.5 * BRICK_STEP };
        let reach = (radius / BRICK_STEP).ceil() as i32;
        for j in -reach..=reach {
            for i in -reach..=reach {
                let (x, y) = (i as f32 * BRICK_STEP + shift, j as f32 * BRICK_STEP + shift);
                if x * x + y * y <= radius * radius {
                    homes.push([x, y, z]);
                }
            }
        }
    }
    homes.truncate(n);
    shuffle(&mut homes, random);
    let boxes = homes
        .iter()
        .map(|home| {
            let centre = home.map(|h| h + random.range(-BRICK_JITTER, BRICK_JITTER));
            around(centre, [(); 3].map(|()| random.range(0.9, 1.1)))
        })
        .collect();
    Scene::drifting(boxes, Walls::Cage { home: homes, radius: BRICK_JITTER }, random)
}

const BLOB_BOXES: usize = 2_000;
/// Standard deviation of a blob. Pairs inside one blob: 1,000 / (π σ²) a box, that is 2.5.
const BLOB_SIGMA: f32 = 11.3;
/// Area a blob, as the edge of its square. Blobs across each other add 0.5 pairs a box.
const BLOB_SPACING: f32 = 90.0;

/// Boxes on a plane in Gaussian blobs, all of them overlapping on z.
pub(super) fn plane(n: usize, random: &mut Random) -> Scene {
    let blob_count = n.div_ceil(BLOB_BOXES).max(1);
    let side = BLOB_SPACING * (blob_count as f32).sqrt();
    let blobs: Vec<_> =
        (0..blob_count).map(|_| [random.range(0.0, side), random.range(0.0, side)]).collect();
    // A last blob that is not full keeps the density of the full ones.
    let sigma = BLOB_SIGMA * ((n as f32 / blob_count as f32) / BLOB_BOXES as f32).sqrt();
    let boxes = (0..n)
        .map(|_| {
            let blob = blobs[random.below(blob_count as u64) as usize];
            let centre = [
                blob[0] + sigma * random.normal(),
                blob[1] + sigma * random.normal(),
                random.range(-0.2, 0.2),
            ];
            let edges = [random.range(0.8, 1.2), random.range(0.8, 1.2), random.range(1.0, 1.2)];
            around(centre, edges)
        })
        .collect();
    let low = [-5.0 * sigma, -5.0 * sigma, -0.2];
    let high = [side + 5.0 * sigma, side + 5.0 * sigma, 0.2];
    Scene::drifting(boxes, Walls::Scene { low, high }, random)
}

/// Object order carries no hint of place.
fn shuffle<T>(entries: &mut [T], random: &mut Random) {
    for last in (1..entries.len()).rev() {
        entries.swap(last, random.below(last as u64 + 1) as usize);
    }
}

const COLUMN_HEIGHT: usize = 32;
/// Distance between columns, in units of the objects' nominal size 1.
const COLUMN_STEP: f32 = 1.3;
/// Mean distance of objects that have landed, and of those that fall.
const LANDED_STEP: f32 = 0.75;
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
pub(super) fn turned(edges: [f32; 3], random: &mut Random) -> [f32; 3] {
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

/// A letter: thin, of any width and height, and of sizes 1 to 3.
pub(super) fn letter(random: &mut Random) -> [f32; 3] {
    let size = random.log_range(0.5, 1.5);
    let edges = [size * random.range(0.3, 1.0), 0.2 * size, size];
    turned(edges, random)
}

/// How far off the outliers of `one-cell` are: the scene's side times this.
const OUTLIER_SIDES: f32 = 4_000.0;

/// A uniform scene and up to eight far boxes, one for each corner of a huge cube.
pub(super) fn one_cell(n: usize, random: &mut Random) -> Scene {
    let mut scene = uniform(n, random);
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
    in_cube(n, 1_174.0, random, |random| {
        let mut edges = [1.0; 3];
        edges[random.below(3) as usize] = ROD_LENGTH;
        edges
    })
}

/// Dust of the density of `uniform`; one box in a thousand is a tenth of the scene wide (at most 16
/// of them), one is an infinite ground, and one covers everything.
pub(super) fn giants(n: usize, random: &mut Random) -> Scene {
    let mut scene = uniform(n, random);
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
    let mut scene = uniform(n, random);
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
