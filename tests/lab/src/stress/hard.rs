//! Scenes for `stress` alone. Where [`super::scenes`] draws boxes one by one, these draw a border first
//! (a cell of a grid, a step of a quantisation, the last bit of a coordinate) and then put faces on it,
//! beside it and across it.

use pairmask_core::Aabb;
use pairmaskd::scene::Random;

type Make = fn(usize, &mut Random) -> Vec<Aabb>;

pub const ALL: &[(&str, Make)] = &[
    // Boxes along one axis, each touching the next or one ulp away from it.
    ("chain of touching boxes", |n, random| {
        let axis = random.below(3) as usize;
        let edge = [0.1f32, 1.0, 1e-3, 1.0 / 3.0][random.below(4) as usize];
        boxes(n, |i| {
            let gap = random.below(4) == 0;
            let low = i as f32 * edge;
            let low = if gap { low.next_up() } else { low };
            let mut intervals = [[-1.0, 1.0]; 3];
            intervals[axis] = [low, (i + 1) as f32 * edge];
            intervals
        })
    }),
    // Unit boxes 10^3 to 10^30 from the origin, a few steps of the float there from each other.
    ("unit boxes far away", |n, random| {
        let offset: [f32; 3] = std::array::from_fn(|_| {
            let offset = power_of_ten(3 + random.below(28) as u32);
            [offset, -offset, 0.0][random.below(3) as usize]
        });
        boxes(n, |_| {
            std::array::from_fn(|axis| {
                let step = (offset[axis].next_up() - offset[axis]).abs().max(1.0);
                let low = small(random, 7).mul_add(step, offset[axis]);
                [low, low + 1.0]
            })
        })
    }),
    // Sizes and places from 10^−30 to 10^30.
    ("sixty decades of sizes", |n, random| {
        let mut decade = || {
            let k = random.below(61) as u32;
            let size = if k < 30 { 1.0 / power_of_ten(30 - k) } else { power_of_ten(k - 30) };
            let share = 1.0 + 9.0 * random.unit();
            (size * share, random.below(2) == 0)
        };
        boxes(n, |_| {
            std::array::from_fn(|_| {
                let ((slot, negative), (size, centred)) = (decade(), decade());
                let slot = if negative { -slot } else { slot };
                if centred { [-size, size] } else { [slot, slot + size] }
            })
        })
    }),
    // Faces at ±max, its neighbours, ±infinity, ±0 and the least subnormals.
    ("faces at the ends of f32", |n, random| {
        let ends = [
            f32::NEG_INFINITY,
            f32::MIN,
            f32::MIN.next_up(),
            -f32::MIN_POSITIVE,
            -1e-45,
            -0.0,
            0.0,
            1e-45,
            f32::MIN_POSITIVE,
            f32::MAX.next_down(),
            f32::MAX,
            f32::INFINITY,
        ];
        boxes(n, |_| {
            std::array::from_fn(|_| {
                let (a, b) = (random.below(12) as usize, random.below(12) as usize);
                [ends[a.min(b)], ends[a.max(b)]]
            })
        })
    }),
    // Cubes whose faces lie on, beside and across the borders of cells of the cubes' own length. The
    // grid makes its cells 0.1 % longer than the longest edge and starts them at the lowest corner, so
    // both lattices are drawn.
    ("grid borders", |n, random| {
        let edge = [1.0f32, 0.7, 1e-20, 3e10][random.below(4) as usize];
        let cell = [edge, edge * 1.001, edge * 2.0][random.below(3) as usize];
        let start = [0.0, -5.0 * edge, 100.0 * edge][random.below(3) as usize];
        let side = 2 + random.below(6);
        boxes(n, |_| {
            std::array::from_fn(|_| {
                let border = small(random, side).mul_add(cell, start);
                let low = ulps(border, nudge(random));
                match random.below(4) {
                    0 => [border - edge, low],
                    1 => [low, low],
                    _ => [low, low + edge],
                }
            })
        })
    }),
    // Faces at steps of a quantisation to 8 or 16 bits over the scene's bounds, and one ulp beside.
    ("quantisation borders", |n, random| {
        let steps = [255u32, 256, 65535, 65536][random.below(4) as usize];
        let (low, high) =
            [(0.0f32, 1.0f32), (-1000.0, 1000.0), (0.1, 0.3), (1e6, 1.001e6), (-1e-3, 7.0)]
                [random.below(5) as usize];
        let base = random.below(u64::from(steps) - 16) as u32;
        boxes(n, |i| {
            if i < 2 {
                // The corners of the scene, so that its bounds are those that were drawn.
                return [[if i == 0 { low } else { high }; 2]; 3];
            }
            std::array::from_fn(|_| {
                // Few different steps, so that faces meet.
                let step = base + random.below(9) as u32;
                let at = |step: u32| (high - low).mul_add(step as f32 / steps as f32, low);
                let from = ulps(at(step), nudge(random));
                let to = ulps(at(step + 1 + random.below(3) as u32), nudge(random));
                [from.min(to), from.max(to)]
            })
        })
    }),
    // Long thin boxes in three directions.
    ("rods", |n, random| {
        let length = [10.0f32, 1e4, 1e30][random.below(3) as usize];
        boxes(n, |i| {
            let long = i % 3;
            std::array::from_fn(|axis| {
                if axis == long {
                    return [-length, length];
                }
                let low = small(random, 40) * 0.25;
                [low, low + [0.0, 0.25, 0.2][random.below(3) as usize]]
            })
        })
    }),
    // A few boxes that hold everything, many that are points.
    ("giants among dust", |n, random| {
        let every = 1 + random.below(40) as usize;
        boxes(n, |i| {
            std::array::from_fn(|_| {
                let at = random.unit();
                if i.is_multiple_of(every) { [-at, at * 1e9] } else { [at, at + 1e-4] }
            })
        })
    }),
];

/// `count` steps up (or down, where negative) in the order of the floats. Infinities stay.
pub fn ulps(x: f32, count: i32) -> f32 {
    let step = if count < 0 { f32::next_down } else { f32::next_up };
    (0..count.unsigned_abs()).fold(x, |x, _| step(x))
}

/// 10^k, exact where f32 can be and the nearest f32 else, the same on every machine.
pub fn power_of_ten(k: u32) -> f32 {
    (0..k).fold(1.0f64, |x, _| x * 10.0) as f32
}

/// A finite f32 of any magnitude: sign, exponent and mantissa at random.
pub fn any_finite(random: &mut Random) -> f32 {
    loop {
        let x = f32::from_bits(random.bits() as u32);
        if x.is_finite() {
            return x;
        }
    }
}

fn small(random: &mut Random, bound: u64) -> f32 {
    random.below(bound) as f32
}

fn nudge(random: &mut Random) -> i32 {
    random.below(3) as i32 - 1
}

fn boxes(n: usize, mut one: impl FnMut(usize) -> [[f32; 2]; 3]) -> Vec<Aabb> {
    (0..n)
        .map(|i| {
            let intervals = one(i);
            Aabb { min: intervals.map(|[low, _]| low), max: intervals.map(|[_, high]| high) }
        })
        .collect()
}
