//! The first stage of the papers' broad phase: world boxes from transforms, by threads.

use std::hint::black_box;
use std::time::Instant;

use crate::study::ways::{Effort, Pools};
use glam::{Quat, Vec3};
use pairmask_core::Aabb;
use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::update::{Placement, UpdateError, par_update_boxes, update_boxes};
use pairmaskd::scene::{Random, Scene, SceneName};

/// Times of `update_boxes` and `par_update_boxes`, ns a frame, for each number of threads.
///
/// The objects have the sizes of a scene's boxes and turn about their centres.
///
/// # Errors
/// [`UpdateError`]: none for slices of one length.
pub fn update_times(
    scene: SceneName,
    n: usize,
    threads: &[usize],
    pools: &Pools,
    effort: &Effort,
) -> Result<Vec<(usize, Vec<u64>)>, UpdateError> {
    let scene = Scene::new(scene, n, 1);
    let mut random = Random::new(2);
    let (locals, placements): (Vec<Aabb>, Vec<Placement>) =
        scene.boxes().iter().map(|world| object(world, &mut random)).unzip();
    let mut out = vec![Aabb::EMPTY; n];
    let mut times: Vec<(usize, Vec<u64>)> = threads.iter().map(|t| (*t, Vec::new())).collect();
    let start = Instant::now();
    for frame in 0..effort.most_frames {
        if frame >= effort.least_frames && start.elapsed() > effort.time {
            break;
        }
        for (threads, times) in &mut times {
            let (locals, placements) = (black_box(&locals), black_box(&placements));
            let out = &mut out;
            let ns = match pools.of(*threads) {
                None => {
                    let start = Instant::now();
                    update_boxes(locals, placements, out)?;
                    nanoseconds_since(start)
                }
                Some(pool) => pool.install(|| {
                    let start = Instant::now();
                    par_update_boxes(locals, placements, out)?;
                    Ok::<_, UpdateError>(nanoseconds_since(start))
                })?,
            };
            times.push(ns);
        }
    }
    black_box(&out);
    Ok(times)
}

/// An object whose world box is about `world`, and its placement.
fn object(world: &Aabb, random: &mut Random) -> (Aabb, Placement) {
    let (min, max) = (Vec3::from_array(world.min), Vec3::from_array(world.max));
    let half = (max - min) * 0.5;
    let axis = Vec3::from_array(random.direction());
    let turn = Quat::from_axis_angle(axis.normalize_or(Vec3::X), random.range(0.0, 6.0));
    (Aabb::new(-half, half), Placement::rigid(min + half, turn))
}
