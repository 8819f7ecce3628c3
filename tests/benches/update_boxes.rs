//! World boxes from local boxes and transforms: median time of a frame.
//!
//! `cargo bench -p pairmask-tests --bench update_boxes`

use std::hint::black_box;
use std::time::Instant;

use glam::{Affine3A, Quat, Vec3};
use pairmask_core::Aabb;
use pairmask_core::update::{Placement, ToWorld, par_update_boxes, update_boxes};
use pairmask_tests::stress_scenes::Rng;

/// Frames a row.
const FRAMES: usize = 21;

fn main() {
    println!("{:<10} {:>9} {:<8} {:>12} {:>8}", "transform", "n", "threads", "median ns", "ns/box");
    for n in [1000, 100_000, 1_000_000] {
        let mut rng = Rng::new(1);
        let placements: Vec<Placement> = (0..n)
            .map(|_| {
                let [x, y, z] = rng.point();
                let rotation = Quat::from_axis_angle(Vec3::new(x, y, z + 0.1).normalize(), 6.0 * y);
                Placement::rigid(1000.0 * Vec3::from_array(rng.point()), rotation)
            })
            .collect();
        let affines: Vec<Affine3A> = placements
            .iter()
            .map(|p| {
                let rotation = Quat::from_array(p.rotation);
                Affine3A::from_rotation_translation(rotation, p.translation.into())
            })
            .collect();
        let locals = vec![Aabb::new(Vec3::splat(-0.5), Vec3::splat(0.5)); n];
        rows("affine", &locals, &affines);
        rows("placement", &locals, &placements);
    }
}

fn rows<T: ToWorld + Sync>(name: &str, locals: &[Aabb], transforms: &[T]) {
    let n = locals.len();
    let mut out = vec![Aabb::EMPTY; n];
    for (threads, parallel) in [("one", false), ("all", true)] {
        let mut times: Vec<_> = (0..FRAMES)
            .map(|_| {
                let start = Instant::now();
                let (locals, transforms) = (black_box(locals), black_box(transforms));
                let done = if parallel {
                    par_update_boxes(locals, transforms, &mut out)
                } else {
                    update_boxes(locals, transforms, &mut out)
                };
                done.expect("lengths agree");
                black_box(&out);
                start.elapsed().as_nanos()
            })
            .collect();
        times.sort_unstable();
        let median = times[FRAMES / 2];
        println!("{name:<10} {n:>9} {threads:<8} {median:>12} {:>8.2}", median as f64 / n as f64);
    }
}
