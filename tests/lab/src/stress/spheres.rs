//! Spheres under stress: tangent by construction, all magnitudes and classes; their exact pairs.

use pairmask_core::oracle::Pair;
use pairmask_core::sphere::Sphere;
use pairmaskd::scene::Random;

use crate::study::spheres::{families, oracle};

#[derive(Clone, Debug)]
pub struct SphereCase {
    pub spheres: Vec<Sphere>,
    pub pairs: Vec<Pair>,
}

/// Makes the random numbers of spheres independent of those of boxes.
const STREAM: u64 = 0x5048_4552_4553;

impl SphereCase {
    /// The spheres of a case seed: few, since the oracle takes a microsecond a pair.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed ^ STREAM);
        let n = match random.below(8) {
            0..6 => random.below(71),
            6 => 126 + random.below(5),
            // Enough spheres for the engines to look for candidates first.
            _ => 255 + random.below(10),
        } as usize;
        let mut spheres: Vec<Sphere> = match random.below(3) {
            0 => lattice(n, &mut random),
            1 => {
                let mut spheres = Vec::with_capacity(n + 1);
                while spheres.len() < n {
                    let which = random.below(families::ALL.len() as u64) as usize;
                    let (a, b) = (families::ALL[which].make)(&mut random);
                    spheres.extend([a, b]);
                }
                spheres.truncate(n);
                spheres
            }
            _ => {
                let any =
                    |_| Sphere::from(std::array::from_fn(|_| f32::from_bits(random.bits() as u32)));
                (0..n).map(any).collect()
            }
        };
        if random.below(3) == 0 {
            spoil(&mut spheres, &mut random);
        }
        let pairs = oracle::pairs(&spheres);
        Self { spheres, pairs }
    }
}

/// Whole centres and radii, times a power of two: many touch.
fn lattice(n: usize, random: &mut Random) -> Vec<Sphere> {
    let scale = f32::from_bits((1 + random.below(250) as u32) << 23);
    let side = 2 + random.below(30);
    let one = |_| {
        let center = std::array::from_fn(|_| (random.below(side) as f32 - 8.0) * scale);
        Sphere::new(center, random.below(6) as f32 * scale)
    };
    (0..n).map(one).collect()
}

fn spoil(spheres: &mut [Sphere], random: &mut Random) {
    for sphere in spheres {
        let axis = random.below(3) as usize;
        match random.below(24) {
            0 => sphere.radius = -sphere.radius,
            1 => sphere.radius = f32::INFINITY,
            2 => sphere.radius = f32::NEG_INFINITY,
            3 => sphere.radius = f32::NAN,
            4 => sphere.center[axis] = f32::NAN,
            5 => sphere.center[axis] = f32::INFINITY,
            6 => sphere.radius = -0.0,
            7 => sphere.center[axis] = -0.0,
            8 => *sphere = Sphere::EMPTY,
            _ => {}
        }
    }
}
