//! The update stage under stress: local boxes and placements → world boxes, by threads of all
//! floating-point flags.
//!
//! Every thread must write the same box, bit for bit, as a thread of default flags. Where an object is
//! only moved, the exact box is computed by two-sum, and the box must contain it.

use std::sync::Arc;

use glam::{Quat, Vec3};
use pairmask_core::update::{Placement, Transformed, world_box};
use pairmask_core::write::{par_write_boxes, write_boxes};
use pairmask_core::{Aabb, BoxClass};
use pairmaskd::scene::Random;
use rayon::ThreadPool;

use super::Subject;
use super::answer::{Finding, Form, Reply};
use super::case::Case;
use super::modes::{difference_is_at_most, first_unlike};

/// Most boxes of a case: enough for several tasks of the pool.
const MOST_BOXES: usize = 2_500;

/// Makes the random numbers of placements independent of those of boxes.
const STREAM: u64 = 0x5550_4441_5445;

/// The update stage on a pool. With `is_broken` each box shrinks a little, to test that the checks notice.
pub(super) fn updates(name: String, pool: Arc<ThreadPool>, is_broken: bool) -> Subject {
    let answer = move |case: &Case| {
        let locals = &case.boxes[..case.boxes.len().min(MOST_BOXES)];
        let placements = placements(case.seed, locals);
        let flags = &case.flags;
        let [mut expected, mut by_pool, mut by_caller] =
            [(); 3].map(|()| vec![Aabb::EMPTY; locals.len()]);
        let source = Transformed::new(locals, &placements);
        write_boxes(&source, &mut expected);
        flags.install(&pool, || par_write_boxes(&source, &mut by_pool));
        flags.caller.run(|| write_boxes(&source, &mut by_caller));
        let alone = flags.written(locals.len(), |i| world_box(&locals[i], &placements[i]));
        if is_broken {
            by_pool = by_pool.iter().map(crate::sabotage::shrink).collect();
        }
        for (who, got) in [("pool", &by_pool), ("caller", &by_caller), ("writers", &alone)] {
            if let Some(i) = first_unlike(&expected, got) {
                return Err(Finding::other(&format!(
                    "box {i} of the {who} is {:?}, and {:?} with the default flags: {:?} by {:?}",
                    got[i], expected[i], locals[i], placements[i]
                )));
            }
        }
        let is_moved = |i: &usize| placements[*i].rotation == Placement::IDENTITY.rotation;
        let outside = (0..locals.len())
            .filter(is_moved)
            .find(|i| !holds(&expected[*i], &locals[*i], placements[*i].translation));
        outside.map_or(Ok(Reply::Right), |i| {
            Err(Finding::other(&format!(
                "box {i}, {:?}, does not hold {:?} moved by {:?}",
                expected[i], locals[i], placements[i].translation
            )))
        })
    };
    Subject { name, engine: "updates", form: Form::Updates, answer: Box::new(answer) }
}

/// A placement for each box: half of them only move it, by the order of its faces' coordinates.
fn placements(seed: u64, locals: &[Aabb]) -> Vec<Placement> {
    let mut random = Random::new(seed ^ STREAM);
    let of = |local: &Aabb| {
        let scale = [1e-44, 1e-38, 1e-3, 1.0, 1e7][random.below(5) as usize];
        let face = local.min[random.below(3) as usize];
        let unit = if face.is_finite() && random.below(2) == 0 { face } else { scale };
        let mut part = || unit * random.range(-2.0, 2.0).clamp(-1.0, 1.0);
        let translation = [part(), part(), part()];
        if random.below(2) == 0 {
            return Placement { translation, ..Placement::IDENTITY };
        }
        let axis = Vec3::from_array(random.direction());
        let rotation = Quat::from_axis_angle(axis, random.range(-4.0, 4.0)).to_array();
        Placement { translation, rotation, scale: [random.range(0.1, 3.0); 3] }
    };
    locals.iter().map(of).collect()
}

/// Whether a world box holds a local one moved by `by`, in the arithmetic of real numbers.
fn holds(world: &Aabb, local: &Aabb, by: [f32; 3]) -> bool {
    if local.class() != BoxClass::Solid {
        return local.class() == world.class();
    }
    // Whether face ≤ x + y without rounding.
    let is_at_most = |face: f64, x: f64, y: f64| {
        if x.is_infinite() { face <= x } else { difference_is_at_most(face, x, y) }
    };
    (0..3).all(|axis| {
        let by = f64::from(by[axis]);
        is_at_most(f64::from(world.min[axis]), f64::from(local.min[axis]), by)
            && is_at_most(-f64::from(world.max[axis]), -f64::from(local.max[axis]), -by)
    })
}
