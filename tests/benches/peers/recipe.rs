//! Scenes by a few numbers, so that a search can vary them.

use pairmask_core::Aabb;
use pairmaskd::scene::Random;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Overlapping pairs a box, about, where boxes are cubes of one size in one place.
    pub density: f64,
    /// Axes along which boxes are spread; along the others they all overlap.
    pub axes: usize,
    /// Edges are spread evenly over so many powers of ten.
    pub decades: f64,
    /// Share of the boxes that are elongated, how many times along which axes, and along how many axes in turn.
    pub long_share: f64,
    pub aspect: [f64; 3],
    pub turns: usize,
    /// Places that boxes stand in, and how far these lie apart.
    pub sites: usize,
    pub apart: f64,
    /// Share of the boxes that are flung away, and how far.
    pub flung_share: f64,
    pub flung: f64,
    /// Whether a box among those that the grid's sample sees covers everything.
    pub has_giant: bool,
    /// Whether long boxes lie in layers, as woven: each has its place on the third axis.
    pub has_layers: bool,
}

impl Recipe {
    /// Cubes, evenly spread.
    pub const UNIFORM: Self = Self {
        density: 1.0,
        axes: 3,
        decades: 0.0,
        long_share: 0.0,
        aspect: [1.0; 3],
        turns: 1,
        sites: 1,
        apart: 0.0,
        flung_share: 0.0,
        flung: 0.0,
        has_giant: false,
        has_layers: false,
    };

    pub fn random(random: &mut Random) -> Self {
        let mut recipe = Self::UNIFORM;
        for _ in 0..12 {
            recipe = recipe.mutated(random);
        }
        recipe
    }

    /// The same with another of its numbers.
    pub fn mutated(mut self, random: &mut Random) -> Self {
        let mut pick = |values: &[f64]| values[random.below(values.len() as u64) as usize];
        match pick(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]) as usize {
            0 => self.density = pick(&[0.1, 1.0, 3.0]),
            1 => self.axes = pick(&[1.0, 2.0, 3.0, 3.0]) as usize,
            2 => self.decades = pick(&[0.0, 0.3, 1.0, 2.0, 3.0, 5.0]),
            3 => self.long_share = pick(&[0.0, 0.01, 0.1, 0.5, 1.0]),
            4 => {
                let aspects = [1.0, 10.0, 100.0, 1_000.0];
                self.aspect = [pick(&aspects), pick(&aspects[..3]), pick(&[1.0, 0.1, 0.001])];
                self.turns = pick(&[1.0, 2.0, 3.0]) as usize;
            }
            5 => self.sites = pick(&[1.0, 3.0, 50.0, 1_000.0]) as usize,
            6 => self.apart = pick(&[10.0, 1e3, 1e5, 1e7, 1e9]),
            7 => {
                self.flung_share = pick(&[0.0, 0.001, 0.02, 0.1, 0.3]);
                self.flung = pick(&[1e3, 1e6, 1e9, 1e30]);
            }
            _ => {
                self.has_giant = pick(&[0.0, 1.0]) > 0.0;
                self.has_layers = pick(&[0.0, 1.0]) > 0.0;
            }
        }
        self
    }

    /// `n` boxes; the same of the same seed.
    pub fn boxes(&self, n: usize, seed: u64) -> Vec<Aabb> {
        let random = &mut Random::new(seed);
        let unit = |random: &mut Random| f64::from(random.unit());
        // Two cubes of edge 1 in a volume of V overlap with probability 8 / V.
        let side = |n: f64| (4.0 * n / self.density).powf(1.0 / self.axes as f64);
        let side = side(n as f64 / self.sites as f64);
        let sites: Vec<[f64; 3]> =
            (0..self.sites).map(|_| [0; 3].map(|_| self.apart * unit(random))).collect();
        let mut boxes: Vec<Aabb> = (0..n)
            .map(|i| {
                let slot = sites[random.below(self.sites as u64) as usize];
                let is_long = unit(random) < self.long_share;
                let edge = 10f64.powf(-self.decades * unit(random));
                let turn = i % self.turns;
                let mut min = [0.0; 3];
                let mut edges = [edge; 3];
                for axis in 0..3 {
                    let spread = if axis < self.axes { side } else { 0.3 };
                    min[axis] = slot[axis] + spread * unit(random);
                    if is_long {
                        edges[(axis + turn) % 3] = edge * self.aspect[axis];
                    }
                }
                if is_long && self.has_layers {
                    (min[2], edges[2]) = (slot[2] + turn as f64, 0.5);
                }
                if unit(random) < self.flung_share {
                    min = [0; 3].map(|_| self.flung * (unit(random) - 0.5));
                }
                aabb(min, edges)
            })
            .collect();
        if self.has_giant {
            let half = f64::from(f32::MAX) / 2.0;
            boxes[first_sampled(n)] = aabb([-half, -half, -half], [2.0 * half, half, 2.0 * half]);
        }
        boxes
    }
}

/// The first index at which the sample of `cpu-grid` looks.
fn first_sampled(n: usize) -> usize {
    let stretch = n / (n / 16).clamp(256, 1_024).min(n);
    (0x9e37_79b9_7f4a_7c15_u64 >> 33) as usize % stretch
}

fn aabb(min: [f64; 3], edges: [f64; 3]) -> Aabb {
    let max = [0, 1, 2].map(|axis| (min[axis] + edges[axis]) as f32);
    Aabb::new(min.map(|x| x as f32), max)
}
