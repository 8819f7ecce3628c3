//! Where a group is cut in two: by which number of its boxes, and after which share of them.

use super::arrange::Entry;
use crate::aabb::Aabb;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// Most boxes that a cut is chosen by.
const SAMPLE_MOST: usize = 128;
/// Most boxes that the typical edges are taken from.
const EDGES_MOST: usize = 512;
/// The largest boxes, one in so many, do not count as typical: they meet nearly every group, however it is
/// cut.
const GIANTS: usize = 16;
/// Largest magnitude that cuts are computed with; products of three, and sums, stay finite in f64.
const LIMIT: f32 = 1e35;

/// A number of a box that a group may be cut by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct By {
    axis: usize,
    is_size: bool,
}

impl By {
    const ALL: [Self; 6] = [
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

/// How many boxes meet a group of some extent, but for a factor: the product of the group's edges and a
/// box's, on each axis added, as mean over typical boxes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    edges: [f64; 3],
    /// Means of the products y·z, x·z, x·y.
    faces: [f64; 3],
    volume: f64,
}

impl Meeting {
    /// Of the typical ones of some solid boxes.
    pub fn of(entries: &[Entry]) -> Self {
        let step = entries.len().div_ceil(EDGES_MOST).max(1);
        let edges_of = |entry: &Entry| -> [f64; 3] {
            std::array::from_fn(|axis| {
                f64::from(By { axis, is_size: true }.of(&entry.aabb)).max(0.0)
            })
        };
        let mut sample: Vec<[f64; 3]> = entries.iter().step_by(step).map(edges_of).collect();
        let longest = |edges: &[f64; 3]| edges.iter().fold(0.0, |a: f64, b| a.max(*b));
        let typical = sample.len() - sample.len() / GIANTS;
        if (1..sample.len()).contains(&typical) {
            sample.select_nth_unstable_by(typical, |a, b| longest(a).total_cmp(&longest(b)));
            sample.truncate(typical);
        }
        let weight = 1.0 / sample.len().max(1) as f64;
        let mut meeting = Self { edges: [0.0; 3], faces: [0.0; 3], volume: 0.0 };
        for [x, y, z] in sample {
            for (sum, edge) in meeting.edges.iter_mut().zip([x, y, z]) {
                *sum += weight * edge;
            }
            for (sum, face) in meeting.faces.iter_mut().zip([y * z, x * z, x * y]) {
                *sum += weight * face;
            }
            meeting.volume += weight * x * y * z;
        }
        meeting
    }

    /// Of a group with these edges.
    #[inline(always)]
    fn with(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [a, b, c] = self.edges;
        let [yz, xz, xy] = self.faces;
        x * y * z + y * z * a + x * z * b + x * y * c + x * yz + y * xz + z * xy + self.volume
    }
}

/// Bounds of some boxes: mins, then negated maxes, so that both are the lesser of two. The last two do not
/// count.
#[derive(Clone, Copy)]
struct Bounds([f32; 8]);

impl Bounds {
    const NONE: Self = Self([f32::INFINITY; 8]);

    /// How many boxes meet them.
    fn met_by(&self, meeting: &Meeting) -> f64 {
        let edge =
            |axis: usize| f64::from(limited(-self.0[3 + axis])) - f64::from(limited(self.0[axis]));
        meeting.with([edge(0), edge(1), edge(2)])
    }
}

/// A cut.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    pub by: By,
    /// Share of the boxes before it.
    pub share: f32,
}

impl Cut {
    /// The best of those at the mean of each number, by a sample of a group's boxes.
    pub fn choose(entries: &[Entry], meeting: &Meeting, isa: AvailableIsa) -> Self {
        let step = entries.len().div_ceil(SAMPLE_MOST).max(1);
        let mut sides = [[Bounds::NONE; 2]; 6];
        let mut highs = [0; 6];
        part(entries, step, &mut sides, &mut highs, isa);
        let all = entries.len().div_ceil(step) as u32;
        let mut best = Self { by: By::ALL[0], share: 0.5 };
        let mut best_cost = f64::INFINITY;
        for ((sides, by), high) in sides.iter().zip(By::ALL).zip(highs) {
            if high == 0 || high == all {
                continue;
            }
            let low = all - high;
            let [of_low, of_high] = sides.each_ref().map(|side| side.met_by(meeting));
            let cost = f64::from(low) * of_low + f64::from(high) * of_high;
            if best_cost == f64::INFINITY || cost < best_cost {
                best = Self { by, share: low as f32 / all as f32 };
                best_cost = cost;
            }
        }
        best
    }
}

per_isa! {
    /// Parts one of so many boxes at the mean of each number: the bounds of either side, and how many are above.
    fn part<simd: S>(
        entries: &[Entry],
        step: usize,
        sides: &mut [[Bounds; 2]; 6],
        highs: &mut [u32; 6],
    ) {
        let _ = simd;
        let mut sums = [0.0f32; 6];
        let mut count = 0.0;
        let mut at = 0;
        while at < entries.len() {
            let numbers = numbers(&entries[at].aabb);
            for k in 0..6 {
                sums[k] += numbers[k];
            }
            count += 1.0;
            at += step;
        }
        let mut means = sums;
        for mean in &mut means {
            *mean /= count;
        }
        at = 0;
        while at < entries.len() {
            let aabb = &entries[at].aabb;
            let numbers = numbers(aabb);
            let [x, y, z] = aabb.min;
            let [far_x, far_y, far_z] = aabb.max;
            let corners = [x, y, z, -far_x, -far_y, -far_z, x, x];
            for k in 0..6 {
                let is_above = usize::from(numbers[k] > means[k]);
                highs[k] += is_above as u32;
                let bounds = &mut sides[k][is_above].0;
                for i in 0..8 {
                    bounds[i] = if corners[i] < bounds[i] { corners[i] } else { bounds[i] };
                }
            }
            at += step;
        }
    }
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
