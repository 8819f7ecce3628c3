//! Where a group is cut in two: by which number of its boxes, and after which share of them.

use super::arrange::Entry;
use crate::aabb::Aabb;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// Most boxes of a group that a cut is chosen by: twice as many take 8 % of a frame more, and part no better.
const SAMPLE_MOST: usize = 64;
/// The same of a group of at most [`SMALL`] boxes.
const SAMPLE_SMALL: usize = 16;
const SMALL: usize = 512;
/// Most others that a cut is chosen by.
const OTHERS_MOST: usize = 128;
/// Boxes so many times as long as the mean do not count: they meet nearly every group, however it is cut.
const GIANT: f32 = 4.0;
/// Largest magnitude that cuts are computed with; products of three, and sums, stay finite in f64. A sample's own edges
/// are in units of their mean, so that theirs do in f32.
const LIMIT: f32 = 1e35;

/// A number of a box that a group may be cut by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct By {
    axis: usize,
    is_size: bool,
}

impl By {
    pub const ALL: [Self; 6] = [
        Self { axis: 0, is_size: false },
        Self { axis: 1, is_size: false },
        Self { axis: 2, is_size: false },
        Self { axis: 0, is_size: true },
        Self { axis: 1, is_size: true },
        Self { axis: 2, is_size: true },
    ];

    /// Twice the centre, or the edge, on the axis.
    #[inline(always)]
    pub fn of(self, b: &Aabb) -> f32 {
        let (min, max) = (b.min[self.axis], b.max[self.axis]);
        limited(if self.is_size { max - min } else { max + min })
    }
}

/// A number within the limits; the lowest for the NaN of opposite infinities.
#[inline(always)]
fn limited(x: f32) -> f32 {
    let above = if x > -LIMIT { x } else { -LIMIT };
    if above < LIMIT { above } else { LIMIT }
}

/// How many boxes meet a group of some extent: for each box the product of the group's edges and its own, on each
/// axis added; as sum over boxes that are spread over a unit of volume.
#[derive(Clone, Copy, Debug, Default)]
struct Density {
    count: f64,
    edges: [f64; 3],
    /// Sums of the products y·z, x·z, x·y.
    faces: [f64; 3],
    volume: f64,
}

impl Density {
    /// Of a count, and sums of edges, faces and volumes, in the order of the fields and in units of a length.
    fn of(sums: [f32; 8], unit: f32) -> Self {
        let [count, x, y, z, yz, xz, xy, volume] = sums.map(f64::from);
        let unit = f64::from(unit);
        Self {
            count,
            edges: [x, y, z].map(|edge| unit * edge),
            faces: [yz, xz, xy].map(|face| unit * unit * face),
            volume: unit * unit * unit * volume,
        }
    }

    #[inline(always)]
    fn add(&mut self, edges: [f32; 3], weight: f64) {
        let [x, y, z] = edges.map(f64::from);
        self.count += weight;
        for (sum, edge) in self.edges.iter_mut().zip([x, y, z]) {
            *sum += weight * edge;
        }
        for (sum, face) in self.faces.iter_mut().zip([y * z, x * z, x * y]) {
            *sum += weight * face;
        }
        self.volume += weight * (x * y * z);
    }

    /// Of boxes all of which meet a group with these edges.
    fn around(self, edges: [f64; 3]) -> Self {
        let met = self.met_by(edges);
        if met > 0.0 { self.scaled(self.count / met) } else { Self::default() }
    }

    fn scaled(self, by: f64) -> Self {
        Self {
            count: by * self.count,
            edges: self.edges.map(|edge| by * edge),
            faces: self.faces.map(|face| by * face),
            volume: by * self.volume,
        }
    }

    fn plus(self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            edges: std::array::from_fn(|axis| self.edges[axis] + other.edges[axis]),
            faces: std::array::from_fn(|axis| self.faces[axis] + other.faces[axis]),
            volume: self.volume + other.volume,
        }
    }

    /// Boxes that meet a group with these edges.
    #[inline(always)]
    fn met_by(&self, [x, y, z]: [f64; 3]) -> f64 {
        let ([a, b, c], [yz, xz, xy]) = (self.edges, self.faces);
        let edges = y * z * a + x * z * b + x * y * c;
        self.count * x * y * z + edges + x * yz + y * xz + z * xy + self.volume
    }
}

/// A box that does not belong to a group, but meets it. It stands for several.
#[derive(Clone, Copy)]
struct Other {
    aabb: Aabb,
    weight: f32,
}

/// What a group has around it: in a heap of rods of three directions, those of the other two; of woven wires, those of
/// the other layer not.
#[derive(Clone, Default)]
pub(super) struct Surroundings {
    others: Vec<Other>,
    density: Density,
}

impl Surroundings {
    /// Of one side of a cut, with boxes of the other side.
    fn of(side: &Bounds, others: &[Other], beside: &[Entry]) -> Self {
        let step = beside.len().div_ceil(OTHERS_MOST).max(1);
        let sampled = beside.iter().step_by(step);
        let sampled = sampled.map(|entry| Other { aabb: entry.aabb, weight: step as f32 });
        let near = others.iter().copied().chain(sampled).filter(|other| side.meets(&other.aabb));
        let near: Vec<Other> = near.collect();
        let step = near.len().div_ceil(OTHERS_MOST).max(1);
        let thinned = near.iter().step_by(step);
        let others: Vec<Other> =
            thinned.map(|other| Other { weight: other.weight * step as f32, ..*other }).collect();
        let mut density = Density::default();
        for other in &others {
            density.add(edges(&other.aabb), f64::from(other.weight));
        }
        Self { others, density: density.around(side.edges()) }
    }
}

/// Bounds of some boxes: mins, then negated maxes, so that both are the lesser of two. The last two do not
/// count.
#[derive(Clone, Copy)]
struct Bounds([f32; 8]);

impl Bounds {
    const NONE: Self = Self([f32::INFINITY; 8]);

    fn edges(&self) -> [f64; 3] {
        let limited = |at: usize| f64::from(limited(self.0[at]));
        std::array::from_fn(|axis| -limited(3 + axis) - limited(axis))
    }

    fn with(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| if other.0[i] < self.0[i] { other.0[i] } else { self.0[i] }))
    }

    fn meets(&self, b: &Aabb) -> bool {
        (0..3).all(|axis| self.0[axis] <= b.max[axis] && b.min[axis] <= -self.0[3 + axis])
    }
}

/// A cut.
#[derive(Clone, Copy)]
pub(super) struct Cut {
    pub by: By,
    /// Mean of that number.
    pub mean: f32,
    /// Share of the boxes before it.
    pub share: f32,
    sides: [Bounds; 2],
}

impl Cut {
    /// The best of those at the mean of each number, by a sample of a group's boxes.
    pub fn choose(entries: &[Entry], around: &Surroundings, isa: AvailableIsa) -> Self {
        let most = if entries.len() > SMALL { SAMPLE_MOST } else { SAMPLE_SMALL };
        let step = entries.len().div_ceil(most).max(1);
        let mut parts = Parts::default();
        part(entries, step, &mut parts, isa);
        let Parts { means, sides, highs, own } = parts;
        let whole = sides[0][0].with(&sides[0][1]);
        let density = own.scaled(step as f64).around(whole.edges()).plus(&around.density);
        let all = entries.len().div_ceil(step) as u32;
        let mut best = Self { by: By::ALL[0], mean: means[0], share: 0.5, sides: sides[0] };
        let mut best_cost = f64::INFINITY;
        for (((sides, by), mean), high) in sides.into_iter().zip(By::ALL).zip(means).zip(highs) {
            if high == 0 || high == all {
                continue;
            }
            let low = all - high;
            let [of_low, of_high] = sides.each_ref().map(|side| density.met_by(side.edges()));
            let cost = f64::from(low) * of_low + f64::from(high) * of_high;
            if best_cost == f64::INFINITY || cost < best_cost {
                best = Self { by, mean, share: low as f32 / all as f32, sides };
                best_cost = cost;
            }
        }
        best
    }

    /// What the boxes before the cut and those after it have around them.
    pub fn surroundings(
        &self,
        (low, high): (&[Entry], &[Entry]),
        around: &Surroundings,
    ) -> [Surroundings; 2] {
        let [of_low, of_high] = &self.sides;
        let others = &around.others;
        [Surroundings::of(of_low, others, high), Surroundings::of(of_high, others, low)]
    }
}

/// Some boxes of a group, parted at the mean of each number.
struct Parts {
    means: [f32; 6],
    sides: [[Bounds; 2]; 6],
    /// How many are above.
    highs: [u32; 6],
    own: Density,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            means: [0.0; 6],
            sides: [[Bounds::NONE; 2]; 6],
            highs: [0; 6],
            own: Density::default(),
        }
    }
}

per_isa! {
    /// Parts one of so many boxes.
    fn part<simd: S>(entries: &[Entry], step: usize, parts: &mut Parts) {
        let _ = simd;
        let mut sums = [0.0f32; 6];
        let mut longest = 0.0;
        let mut count = 0.0;
        let mut at = 0;
        while at < entries.len() {
            let numbers = numbers(&entries[at].aabb);
            for k in 0..6 {
                sums[k] += numbers[k];
            }
            longest += longest_of(own_edges(&numbers));
            count += 1.0;
            at += step;
        }
        let mut means = sums;
        for mean in &mut means {
            *mean /= count;
        }
        parts.means = means;
        let unit = longest / count;
        // Where boxes are points, their edges count as none.
        let units = if unit > f32::MIN_POSITIVE { 1.0 / unit } else { 0.0 };
        let mut own = [0.0f32; 8];
        at = 0;
        while at < entries.len() {
            let aabb = &entries[at].aabb;
            let numbers = numbers(aabb);
            let [x, y, z] = own_edges(&numbers);
            let [x, y, z] = [x * units, y * units, z * units];
            let counts = if longest_of([x, y, z]) <= GIANT { 1.0 } else { 0.0 };
            let sums = [1.0, x, y, z, y * z, x * z, x * y, x * y * z];
            for i in 0..8 {
                own[i] += counts * sums[i];
            }
            let [x, y, z] = aabb.min;
            let [far_x, far_y, far_z] = aabb.max;
            let corners = [x, y, z, -far_x, -far_y, -far_z, x, x];
            for k in 0..6 {
                let is_above = usize::from(numbers[k] > means[k]);
                parts.highs[k] += is_above as u32;
                let bounds = &mut parts.sides[k][is_above].0;
                for i in 0..8 {
                    bounds[i] = if corners[i] < bounds[i] { corners[i] } else { bounds[i] };
                }
            }
            at += step;
        }
        parts.own = Density::of(own, unit);
    }
}

/// The edges among a box's numbers; none where it lies at infinity, and its ends are no distance apart.
#[inline(always)]
fn own_edges(numbers: &[f32; 6]) -> [f32; 3] {
    let edge = |number: f32| if number > 0.0 { number } else { 0.0 };
    [edge(numbers[3]), edge(numbers[4]), edge(numbers[5])]
}

#[inline(always)]
fn longest_of([x, y, z]: [f32; 3]) -> f32 {
    let longer = if x > y { x } else { y };
    if longer > z { longer } else { z }
}

/// Edges of a box.
fn edges(b: &Aabb) -> [f32; 3] {
    let [_, _, _, x, y, z] = numbers(b);
    [x, y, z]
}

/// What a box may be parted by, in the order of [`By::ALL`].
#[inline(always)]
fn numbers(b: &Aabb) -> [f32; 6] {
    let ([x, y, z], [far_x, far_y, far_z]) = (b.min, b.max);
    let mut numbers = [far_x + x, far_y + y, far_z + z, far_x - x, far_y - y, far_z - z];
    for number in &mut numbers {
        *number = limited(*number);
    }
    numbers
}
