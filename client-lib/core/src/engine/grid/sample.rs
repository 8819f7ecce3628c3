//! A sample of the scene: sizes, bounds and density, from at most 1,024 boxes.
//!
//! A pure function of the boxes: the layout of the grid, and with it the order of the reply, must
//! not depend on earlier frames.

use crate::aabb::{Aabb, BoxClass};

/// Boxes looked at: one in 16, so that small scenes pay little, between these limits. 1,024
/// boxes see a share of 0.4 % of a scene with 98 % certainty.
const SAMPLE_SHARE: usize = 16;
const SAMPLE_LEAST: usize = 256;
const SAMPLE_MOST: usize = 1_024;
/// Boxes that the median edges are taken from.
const MEDIAN_BOXES: usize = 256;
/// Largest size up to which boxes count as alike; that of the median box is about 1.
const LIKE_SIZES: f32 = 2.0;

/// Sampled boxes in the cell of a sampled box at which the cell is small enough.
const SAMPLE_NEIGHBOURS: f32 = 1.5;
/// Rounds of making the cell smaller: each halves at least one edge, most do ten times as much.
const DENSITY_ROUNDS: usize = 32;

/// What is kept of a sampled box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampledBox {
    pub min: [f32; 3],
    pub edges: [f32; 3],
    /// Largest edge in units of the median edge of its axis.
    pub size: f32,
}

/// The sampled solid boxes and what follows from them.
#[derive(Default)]
pub(crate) struct Sample {
    /// Smallest first, unless they are alike.
    pub boxes: Vec<SampledBox>,
    /// Whether all boxes are of about one size, so that one level will do.
    pub alike: bool,
    /// Smallest finite min on each axis.
    pub low: [f32; 3],
    /// Distance from the smallest to the largest finite min on each axis.
    pub extent: [f32; 3],
    /// Boxes of the scene for one of the sample.
    pub weight: f32,
    scratch: Vec<f32>,
    counts: Vec<u16>,
}

impl Sample {
    /// Looks at a scene.
    pub fn take(&mut self, boxes: &[Aabb]) {
        let n = boxes.len();
        let wanted = (n / SAMPLE_SHARE).clamp(SAMPLE_LEAST, SAMPLE_MOST).min(n);
        self.boxes.clear();
        for i in 0..wanted {
            let b = boxes[sample_index(i, wanted, n)];
            if b.class() == BoxClass::Solid {
                let edges = std::array::from_fn(|a| b.max[a] - b.min[a]);
                self.boxes.push(SampledBox { min: b.min, edges, size: 0.0 });
            }
        }
        self.weight = n as f32 / wanted.max(1) as f32;
        self.measure_bounds();
        self.measure_sizes();
    }

    fn measure_bounds(&mut self) {
        for axis in 0..3 {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for x in self.boxes.iter().map(|b| b.min[axis]).filter(|x| x.is_finite()) {
                (low, high) = (low.min(x), high.max(x));
            }
            self.low[axis] = if low.is_finite() { low } else { 0.0 };
            // Finite bounds may be an infinite distance apart.
            self.extent[axis] = if low <= high { (high - low).min(f32::MAX) } else { 0.0 };
        }
    }

    fn measure_sizes(&mut self) {
        let unit: [f32; 3] = std::array::from_fn(|axis| {
            self.scratch.clear();
            let edges = self.boxes.iter().take(MEDIAN_BOXES).map(|b| b.edges[axis]);
            self.scratch.extend(edges.filter(|e| e.is_finite() && *e > 0.0));
            let middle = self.scratch.len() / 2;
            if self.scratch.is_empty() {
                return f32::MIN_POSITIVE;
            }
            *self.scratch.select_nth_unstable_by(middle, f32::total_cmp).1
        });
        for b in &mut self.boxes {
            b.size = (0..3).map(|axis| b.edges[axis] / unit[axis]).fold(0.0, f32::max);
        }
        self.alike = self.boxes.iter().all(|b| b.size <= LIKE_SIZES);
        if !self.alike {
            self.boxes.sort_unstable_by(|a, b| a.size.total_cmp(&b.size));
        }
    }

    /// Boxes of the scene around a box, measured in cells so small that the sample itself has one
    /// or two in them: crowded places count as much as the boxes that are there.
    pub fn density(&mut self) -> Density {
        let mut edges = self.extent.map(|e| (e * 1.001).clamp(f32::MIN_POSITIVE, f32::MAX));
        let mut neighbours = self.neighbours(edges);
        for _ in 0..DENSITY_ROUNDS {
            if neighbours <= SAMPLE_NEIGHBOURS {
                break;
            }
            // Down to the target in few rounds: halving leaves half of the neighbours or more.
            let halvings = (neighbours / SAMPLE_NEIGHBOURS).log2().clamp(1.0, 16.0) as usize;
            edges = halve_longest(edges, halvings);
            neighbours = self.neighbours(edges);
        }
        let count = (neighbours * self.weight).max(0.01);
        let whole = self.extent.map(|extent| extent.max(f32::MIN_POSITIVE));
        let per_unit = std::array::from_fn(|axis| 1.0 / edges[axis].min(whole[axis]));
        Density { per_unit, whole, count }
    }

    /// Mean number of other sampled boxes in the cell of a sampled box.
    fn neighbours(&mut self, edges: [f32; 3]) -> f32 {
        let m = self.boxes.len();
        if m == 0 {
            return 0.0;
        }
        // 16 slots a box: two boxes share a slot by chance once in 16 m² / 2 pairs.
        let slots = (16 * m).next_power_of_two();
        self.counts.clear();
        self.counts.resize(slots, 0);
        let shift = 32 - slots.trailing_zeros();
        let mut pairs = 0u64;
        let per_unit = edges.map(|edge| 1.0 / edge);
        for b in &self.boxes {
            let mut hash = 0u32;
            for axis in 0..3 {
                let cell = ((b.min[axis] - self.low[axis]) * per_unit[axis]) as u32;
                hash = (hash ^ cell).wrapping_mul(0x9e37_79b1).rotate_left(13);
            }
            let slot = &mut self.counts[(hash.wrapping_mul(0x85eb_ca6b) >> shift) as usize];
            pairs += u64::from(*slot);
            *slot = slot.saturating_add(1);
        }
        let by_chance = m as f32 / slots as f32;
        (2.0 * pairs as f32 / m as f32 - by_chance).max(0.0)
    }
}

/// Boxes in the cell of a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Density {
    /// Cells of the measurement for each unit of length.
    per_unit: [f32; 3],
    /// Extent of the scene, above 0.
    whole: [f32; 3],
    count: f32,
}

impl Density {
    /// Other boxes in the cell of a box, for cells of `edges`.
    pub fn in_cell(&self, edges: [f32; 3]) -> f32 {
        (0..3).fold(self.count, |count, axis| {
            count * (edges[axis].min(self.whole[axis]) * self.per_unit[axis])
        })
    }
}

/// Halves a cell on its longest axis so many times, so that flat scenes end with square cells.
fn halve_longest(mut edges: [f32; 3], times: usize) -> [f32; 3] {
    for _ in 0..times {
        let longest = (0..3)
            .fold(0, |longest, axis| if edges[axis] > edges[longest] { axis } else { longest });
        edges[longest] *= 0.5;
    }
    edges
}

/// The box to look at for sample `i` of `wanted`: one of each stretch, at a place that a hash
/// chooses, because scenes are often laid out in rows of some round number.
fn sample_index(i: usize, wanted: usize, n: usize) -> usize {
    let (start, end) = (i * n / wanted, (i + 1) * n / wanted);
    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
    start + hash as usize % (end - start).max(1)
}
