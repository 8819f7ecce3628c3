//! Seeded scenes that provoke wrong answers: extreme floats, borders and box classes. Each takes any
//! number of boxes, and uses only operations that round alike on all machines.

use std::fmt;

use pairmask_core::Aabb;
use pairmaskd::scene::Random;

#[derive(Clone, Copy)]
pub struct StressScene {
    name: &'static str,
    /// Whether a fixed share of all pairs overlaps; else about as many as there are boxes.
    pub is_quadratic: bool,
    make: fn(u32, u32, &mut Rng) -> Aabb,
}

impl StressScene {
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// `n` boxes; the same for the same seed.
    pub fn boxes(&self, n: u32, seed: u64) -> Vec<Aabb> {
        let mut rng = Rng::new(seed ^ u64::from(n) << 32);
        (0..n).map(|i| (self.make)(i, n, &mut rng)).collect()
    }
}

impl fmt::Debug for StressScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "scene '{}'", self.name)
    }
}

/// [`Random`], with the draws on which the golden hashes of these scenes rest.
pub struct Rng(Random);

impl Rng {
    /// A stream of its own for every seed.
    pub fn new(seed: u64) -> Self {
        Self(Random::new(seed))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// A number below `bound`, which must not be 0.
    pub fn below(&mut self, bound: u32) -> u32 {
        (self.bits() % u64::from(bound)) as u32
    }

    /// A number in 0..1 with 24 random bits.
    pub fn unit(&mut self) -> f32 {
        self.0.unit()
    }

    /// Three of [`Self::unit`].
    pub fn point(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.unit())
    }
}

/// Stress scenes. Each makes box `i` of `n`.
pub const ALL: &[StressScene] = &[
    quadratic("identical", |_, _, _| Aabb::from([-1.5, 0.25, 3.0, -1.25, 0.5, 4.0])),
    // Unit cubes of a cubic lattice: every face, edge and corner touches.
    few("lattice", |i, n, _| {
        let side = (1..1625u32).find(|s| s.pow(3) >= n).unwrap_or(1625);
        let at = [i % side, i / side % side, i / side / side];
        boxed(at.map(|x| x as f32 - 2.0), [1.0; 3])
    }),
    few("empty mixed in", empty_mixed_in),
    few("all empty", |_, _, _| Aabb::EMPTY),
    // One NaN, of either sign and kind, that walks through the six slots; one box in seven has none.
    few("nan in each slot", |i, n, rng| {
        let mut slots = <[f32; 6]>::from(empty_mixed_in(i, n, rng));
        let payload =
            [0x7fc0_0000, 0xffc0_0000, 0x7f80_0001, 0xff80_0001, 0x7fff_ffff, 0xffff_ffff];
        if let Some(slot) = slots.get_mut((i % 7) as usize) {
            *slot = f32::from_bits(payload[rng.below(6) as usize]);
        }
        Aabb::from(slots)
    }),
    quadratic("infinite", |i, n, rng| {
        let mut b = uniform(i, n, rng);
        for axis in 0..3 {
            match rng.below(6) {
                0 => b.min[axis] = f32::NEG_INFINITY,
                1 => b.max[axis] = f32::INFINITY,
                2 => (b.min[axis], b.max[axis]) = (f32::NEG_INFINITY, f32::INFINITY),
                3 => (b.min[axis], b.max[axis]) = (f32::INFINITY, f32::INFINITY),
                _ => {}
            }
        }
        b
    }),
    // Faces at +0 and −0, in either order: a box from +0 to −0 is a point, not empty.
    quadratic("signed zeroes", |_, _, rng| {
        let min = pick([0.0, -0.0, -1.0, 0.0, -0.0, 1e-45], rng);
        let max = pick([0.0, -0.0, 1.0, 0.0, -0.0, -1e-45], rng);
        Aabb { min, max }
    }),
    // Subnormal faces that touch or leave a gap of one subnormal.
    quadratic("subnormals", |_, _, rng| {
        let face = |rng: &mut Rng| f32::from_bits(rng.below(9) | rng.below(2) << 31);
        let (a, b) = (std::array::from_fn(|_| face(rng)), std::array::from_fn(|_| face(rng)));
        either_order(a, b)
    }),
    quadratic("huge", |_, _, rng| {
        let faces = [-3e38, 3e38, f32::MIN, f32::MAX, -2.9e38, 2.9e38, 0.0, 1.0];
        either_order(pick(faces, rng), pick(faces, rng))
    }),
    // Faces one unit in the last place apart, around powers of two, where the unit changes.
    quadratic("ulp-adjacent faces", |_, _, rng| {
        let face = |rng: &mut Rng| {
            let at = [1.0f32, 2.0, -1.0, 1024.0, -0.5][rng.below(5) as usize];
            f32::from_bits(at.to_bits() + rng.below(5) - 2)
        };
        let (a, b) = (std::array::from_fn(|_| face(rng)), std::array::from_fn(|_| face(rng)));
        either_order(a, b)
    }),
    quadratic("zero thickness", |_, _, rng| {
        let corner = [rng.below(4), rng.below(4), rng.below(4)].map(|x| x as f32 * 0.1);
        let mut size = [0.1 * rng.below(3) as f32, 0.1, 0.1];
        size[rng.below(3) as usize] = 0.0;
        boxed(corner, size)
    }),
    quadratic("random bits", random_bits),
    // Random bits with the faces in order, so that most boxes are valid.
    quadratic("random key order", |i, n, rng| {
        let b = random_bits(i, n, rng);
        either_order(b.min, b.max)
    }),
    few("uniform", uniform),
    quadratic("clustered", |_, n, rng| {
        let center = [rng.below(3), rng.below(2), rng.below(5)].map(|x| 40.0 * x as f32 - 60.0);
        let (p, q) = (rng.point(), rng.point());
        let size = 4.0 * inverse_cube_root_of_half(n);
        boxed(std::array::from_fn(|axis| center[axis] + 4.0 * (p[axis] + q[axis])), [size; 3])
    }),
    // A plane world: every box has the same height.
    few("flat", |_, n, rng| {
        let p = rng.point();
        let edge = shrunk_until(|edge| edge * edge * n as f32 <= 2.0);
        boxed([100.0 * p[0], 100.0 * p[1], 5.0], [50.0 * edge, 50.0 * edge, 1.0])
    }),
    // Edges from 2^−20 to 1 of the scene.
    quadratic("sizes over 20 octaves", |_, _, rng| {
        let octave = f32::from_bits((127 - rng.below(21)) << 23);
        boxed(rng.point(), rng.point().map(|x| octave * x))
    }),
    // Small boxes on one box that is wider than all of them together, and infinite in depth.
    few("ground plane", |i, n, rng| {
        if i == n / 2 {
            return Aabb { min: [-1e9, -1e9, f32::NEG_INFINITY], max: [1e9, 1e9, 0.0] };
        }
        uniform(i, n, rng)
    }),
    // Coordinates near 2^24, where one unit in the last place is 1 or 2.
    quadratic("far from the origin", |_, _, rng| {
        let corner = rng.point().map(|x| 16_777_216.0 + 16.0 * (x - 0.5));
        boxed(corner, pick([0.0, 0.5, 1.0, 3.0], rng))
    }),
    // Among ordinary boxes a finite half-space, and one in fifty that was flung away, to either side.
    few("outliers", |i, n, rng| {
        let (b, at) = (uniform(i, n, rng), rng.point());
        let half = f32::MAX / 2.0;
        match i % 50 {
            7 if i > 50 => boxed(at.map(|x| 2e7 * (x - 0.5)), [1.0; 3]),
            7 => Aabb { min: [-half; 3], max: [half, 0.0, half] },
            _ => b,
        }
    }),
    // Few boxes in each of many places, so far from one another that no table has cells for what lies between.
    few("clusters far apart", |_, n, rng| {
        let at = rng.below(n / 16 + 1);
        let position = [at, at.wrapping_mul(0x9e37), at.wrapping_mul(0x85eb_ca6b)];
        let corner = position.map(|x| (x % 1_024) as f32 * 16_384.0 - 8_388_608.0);
        let p = rng.point();
        boxed(std::array::from_fn(|axis| corner[axis] + 4.0 * p[axis]), [1.0; 3])
    }),
];

/// Scenes that no cells part, for engines that take any scene: a GPU's grid may refuse them.
pub const CROWDED: &[StressScene] = &[
    // Wires of a chip: half of the boxes cross it along x, the others along y on the layer above; one in a hundred
    // reaches both layers.
    few("woven", |i, n, rng| {
        let (at, length) = (n as f32 * rng.unit(), n as f32);
        let top = if i % 100 == 41 { 0.75 } else { 0.375 };
        if i % 2 == 0 {
            boxed([at, 0.0, 0.5], [0.125, length, 0.5])
        } else {
            boxed([0.0, at, 0.0], [length, 0.125, top])
        }
    }),
    // A thousand times as long as thick, along each axis.
    few("rods", |i, _, rng| {
        let mut size = [0.125; 3];
        size[i as usize % 3] = 128.0;
        boxed(rng.point().map(|x| 512.0 * x), size)
    }),
];

const fn few(name: &'static str, make: fn(u32, u32, &mut Rng) -> Aabb) -> StressScene {
    StressScene { name, is_quadratic: false, make }
}

const fn quadratic(name: &'static str, make: fn(u32, u32, &mut Rng) -> Aabb) -> StressScene {
    StressScene { name, is_quadratic: true, make }
}

/// # Panics
/// Where there is no scene of that name.
pub fn named(name: &str) -> &'static StressScene {
    ALL.iter().chain(CROWDED).find(|scene| scene.name == name).expect("a scene of that name")
}

fn boxed(min: [f32; 3], size: [f32; 3]) -> Aabb {
    Aabb { min, max: std::array::from_fn(|axis| min[axis] + size[axis]) }
}

fn either_order(a: [f32; 3], b: [f32; 3]) -> Aabb {
    let min = std::array::from_fn(|axis| if a[axis] < b[axis] { a[axis] } else { b[axis] });
    let max = std::array::from_fn(|axis| if a[axis] < b[axis] { b[axis] } else { a[axis] });
    Aabb { min, max }
}

fn empty_mixed_in(i: u32, n: u32, rng: &mut Rng) -> Aabb {
    let mut b = uniform(i, n, rng);
    let axis = rng.below(3) as usize;
    match rng.below(4) {
        0 => b.min[axis] = b.max[axis].next_up(),
        1 => b = Aabb::EMPTY,
        _ => {}
    }
    b
}

fn pick<const N: usize>(values: [f32; N], rng: &mut Rng) -> [f32; 3] {
    std::array::from_fn(|_| values[rng.below(N as u32) as usize])
}

fn random_bits(_: u32, _: u32, rng: &mut Rng) -> Aabb {
    let slots: [f32; 6] = std::array::from_fn(|_| f32::from_bits(rng.bits() as u32));
    Aabb::from(slots)
}

/// Cubes at random, about one pair a box.
fn uniform(_: u32, n: u32, rng: &mut Rng) -> Aabb {
    let corner = rng.point().map(|x| 100.0 * x);
    // Two cubes of edge s in a volume of V overlap with probability 8s³/V.
    boxed(corner, [50.0 * inverse_cube_root_of_half(n); 3])
}

/// (n/2)^(−1/3) within 10 %.
fn inverse_cube_root_of_half(n: u32) -> f32 {
    shrunk_until(|edge| edge * edge * edge * n as f32 <= 2.2)
}

/// 1, made smaller until it fits, in place of a root: `cbrt` may differ from one libm to another.
fn shrunk_until(fits: impl Fn(f32) -> bool) -> f32 {
    let mut edge = 1.0;
    while !fits(edge) {
        edge *= 0.9375;
    }
    edge
}
