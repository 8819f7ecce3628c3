//! Changes to a scene after it was drawn: order, axes, magnitude, and empty or invalid boxes.

use pairmask_core::Aabb;
use pairmaskd::scene::Random;

use super::hard::{power_of_ten, ulps};

/// Changes the boxes of a scene in place; their number stays.
type Apply = fn(&mut [Aabb], &mut Random);

pub const ALL: &[(&str, Apply)] = &[
    ("sorted", |boxes, random| sort(boxes, random, false)),
    ("sorted in reverse", |boxes, random| sort(boxes, random, true)),
    ("shuffled", |boxes, random| {
        for last in (1..boxes.len()).rev() {
            boxes.swap(last, random.below(last as u64 + 1) as usize);
        }
    }),
    ("axes exchanged", |boxes, random| {
        let (a, b) = [(0, 1), (0, 2), (1, 2)][random.below(3) as usize];
        for one in boxes {
            one.min.swap(a, b);
            one.max.swap(a, b);
        }
    }),
    ("mirrored", |boxes, random| {
        let axis = random.below(3) as usize;
        for one in boxes {
            (one.min[axis], one.max[axis]) = (-one.max[axis], -one.min[axis]);
        }
    }),
    ("scaled by a power of two", |boxes, random| {
        // 2^−126 to 2^127: small scenes become subnormal, large ones infinite.
        let factor = f32::from_bits((1 + random.below(254) as u32) << 23);
        (0..3).for_each(|axis| map_axis(boxes, axis, |x| x * factor));
    }),
    ("moved far away", |boxes, random| {
        let offset = power_of_ten(3 + random.below(28) as u32);
        let axis = random.below(3) as usize;
        map_axis(boxes, axis, |x| x + offset);
    }),
    // Moves faces of boxes to where others end, or one ulp before or after.
    ("faces copied", |boxes, random| {
        let n = boxes.len();
        for i in 0..n {
            let (from, axis) = (random.below(n as u64) as usize, random.below(3) as usize);
            if random.below(2) == 0 {
                boxes[i].min[axis] = ulps(boxes[from].max[axis], random.below(3) as i32 - 1);
                boxes[i].max[axis] = boxes[i].max[axis].max(boxes[i].min[axis]);
            }
        }
    }),
    ("boxes doubled", |boxes, random| {
        let n = boxes.len();
        for i in 0..n {
            if random.below(3) == 0 {
                boxes[i] = boxes[random.below(n as u64) as usize];
            }
        }
    }),
    ("one axis flat", |boxes, random| {
        let axis = random.below(3) as usize;
        let thickness = random.below(2) as f32;
        for one in boxes {
            (one.min[axis], one.max[axis]) = (5.0, 5.0 + thickness);
        }
    }),
    ("zeros of either sign", |boxes, random| {
        for one in boxes {
            for x in one.min.iter_mut().chain(&mut one.max) {
                if *x == 0.0 || random.below(8) == 0 {
                    *x = if random.below(2) == 0 { 0.0 } else { -0.0 };
                }
            }
        }
    }),
    ("empty boxes", |boxes, random| {
        some(boxes, random, 5, |one, random| {
            let axis = random.below(3) as usize;
            if random.below(2) == 0 {
                *one = Aabb::EMPTY;
            } else {
                one.min[axis] = one.max[axis].next_up();
            }
        });
    }),
    ("NaN in some slots", |boxes, random| {
        let nans = [0x7fc0_0000, 0xffc0_0000, 0x7f80_0001, 0xff80_0001, 0x7fff_ffff, 0xffff_ffff];
        some(boxes, random, 6, |one, random| {
            let nan = f32::from_bits(nans[random.below(6) as usize]);
            let axis = random.below(3) as usize;
            if random.below(2) == 0 { one.min[axis] = nan } else { one.max[axis] = nan }
        });
    }),
    ("infinite faces", |boxes, random| {
        some(boxes, random, 6, |one, random| {
            let axis = random.below(3) as usize;
            match random.below(3) {
                0 => one.min[axis] = f32::NEG_INFINITY,
                1 => one.max[axis] = f32::INFINITY,
                _ => (one.min[axis], one.max[axis]) = (f32::INFINITY, f32::INFINITY),
            }
        });
    }),
];

fn sort(boxes: &mut [Aabb], random: &mut Random, reverse: bool) {
    let axis = random.below(3) as usize;
    boxes.sort_by(|a, b| {
        let order = a.min[axis].total_cmp(&b.min[axis]);
        if reverse { order.reverse() } else { order }
    });
}

fn map_axis(boxes: &mut [Aabb], axis: usize, change: impl Fn(f32) -> f32) {
    for one in boxes {
        one.min[axis] = change(one.min[axis]);
        one.max[axis] = change(one.max[axis]);
    }
}

/// Calls `change` with about one box in `every`.
fn some(
    boxes: &mut [Aabb],
    random: &mut Random,
    every: u64,
    mut change: impl FnMut(&mut Aabb, &mut Random),
) {
    for one in boxes {
        if random.below(every) == 0 {
            change(one, random);
        }
    }
}
