//! The four scenes of the anchors.

use super::{Random, Scene, Walls, around};

/// Centres in a cube, edges 0.8 to 1.2.
///
/// Two boxes overlap with probability (mean edge sum)³ / V = 8 / V, so n²/2 pairs of boxes give n
/// overlaps when V = 4n.
pub(super) fn uniform(n: usize, random: &mut Random) -> Scene {
    let side = (4.0 * n as f32).cbrt();
    let boxes = (0..n)
        .map(|_| {
            let edges = [(); 3].map(|()| random.range(0.8, 1.2));
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
    let side = (39.83 * n as f32).cbrt();
    let boxes = (0..n)
        .map(|_| {
            let edge = random.log_range(0.01, 10.0);
            around([(); 3].map(|()| random.range(0.0, side)), [edge; 3])
        })
        .collect();
    Scene::drifting(boxes, Walls::Scene { low: [0.0; 3], high: [side; 3] }, random)
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

/// Boxes of a blob of the plane.
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
fn shuffle<T>(items: &mut [T], random: &mut Random) {
    for last in (1..items.len()).rev() {
        items.swap(last, random.below(last as u64 + 1) as usize);
    }
}
