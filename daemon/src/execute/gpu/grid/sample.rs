//! A look at a few boxes of the scene: bounds and sizes.
//!
//! A pure function of the boxes, so that the same boxes give the same bytes regardless of what came before.

use pairmask_core::engine::grid::near_bounds;
use pairmask_core::objects::Objects;
use pairmask_core::{Aabb, BoxClass};
use pairmask_shaders::mirror::grid_layout::plain;

/// Boxes looked at: 256 see a share of 2 % of a scene with 99 % certainty, and take 5 to 10 µs to
/// fetch from a large scene.
const SAMPLE: usize = 256;
/// Scenes of fewer boxes get a look at half as many: its time is a fifth of what the CPU does for a frame
/// of 10,000 boxes, and a level too coarse costs such a scene less.
const LARGE_SCENE: usize = 16_384;

/// A median is taken of one in so many sampled boxes: to find those of all took half of a look's time, and
/// what they are for (the middle of the scene, the scale of an axis) needs no more.
const MEDIAN_STEP: usize = 4;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SampledBox {
    /// Finite edges: what is longer than the scene ends with it.
    pub edges: [f32; 3],
    /// Largest edge in units of the median edge of its axis.
    pub size: f32,
}

#[derive(Default)]
pub(super) struct Sample {
    pub boxes: Vec<SampledBox>,
    /// Smallest min corner, of those that are not far from all others.
    pub low: [f32; 3],
    pub middle: [f32; 3],
    /// Distance from the smallest to the largest min corner, of those that are not far from all others.
    pub extent: [f32; 3],
    pub has_far: bool,
    /// Valid boxes of the scene, about.
    pub valid: f32,
    scratch: Vec<f32>,
    /// Min corners of these boxes.
    pub mins: Vec<[f32; 3]>,
}

impl Sample {
    pub fn take(&mut self, objects: Objects<'_>) {
        let n = objects.len();
        let requested = n.min(if n < LARGE_SCENE { SAMPLE / 2 } else { SAMPLE });
        self.boxes.clear();
        self.mins.clear();
        // Copied without a look at them, so that the fetches overlap, and because the writer may
        // change its boxes meanwhile.
        let mut copies = [Aabb::EMPTY; SAMPLE];
        for (i, copy) in copies[..requested].iter_mut().enumerate() {
            let at = position(i, requested, n);
            let bounds = match objects {
                Objects::Boxes(boxes) => boxes.get(at),
                Objects::Spheres(spheres) => spheres.get(at).map(|sphere| { *sphere }.bounds()),
            };
            *copy = bounds.unwrap_or(Aabb::EMPTY);
        }
        for b in &copies[..requested] {
            if b.class() == BoxClass::Valid {
                self.mins.push(b.min.map(plain));
                let edges = std::array::from_fn(|a| plain(plain(b.max[a]) - plain(b.min[a])));
                self.boxes.push(SampledBox { edges, size: 0.0 });
            }
        }
        self.valid = n as f32 * self.boxes.len() as f32 / requested.max(1) as f32;
        self.has_far = false;
        for axis in 0..3 {
            let mins = || self.mins.iter().map(|min| min[axis]);
            let Some(middle) = median(&mut self.scratch, mins().step_by(MEDIAN_STEP)) else {
                (self.low[axis], self.middle[axis], self.extent[axis]) = (0.0, 0.0, 0.0);
                continue;
            };
            let mut bounds = (mins().fold(middle, f32::min), mins().fold(middle, f32::max));
            if let Some(near) = near_bounds(bounds, mins(), &mut self.scratch) {
                (bounds, self.has_far) = (near, true);
            }
            let (low, high) = bounds;
            self.low[axis] = low;
            self.middle[axis] = middle;
            self.extent[axis] = high - low;
        }
        self.measure_sizes();
    }

    /// Whether all edges of an axis are the same, up to a factor.
    pub fn is_alike(&self, factor: f32) -> bool {
        (0..3).all(|axis| {
            let edges = || self.boxes.iter().map(|b| b.edges[axis]);
            edges().fold(0.0, f32::max) <= factor * edges().fold(f32::INFINITY, f32::min)
        })
    }

    fn measure_sizes(&mut self) {
        let unit: [f32; 3] = std::array::from_fn(|axis| {
            let edges = self.boxes.iter().step_by(MEDIAN_STEP).map(|b| b.edges[axis]);
            median(&mut self.scratch, edges.filter(|edge| *edge > 0.0)).unwrap_or(1.0)
        });
        let longest: [f32; 3] = std::array::from_fn(|axis| self.extent[axis].max(2.0 * unit[axis]));
        for b in &mut self.boxes {
            b.edges = std::array::from_fn(|axis| b.edges[axis].min(longest[axis]));
            b.size = (0..3).map(|axis| b.edges[axis] / unit[axis]).fold(0.0, f32::max);
        }
    }
}

/// The lower median; `None` of no values.
fn median(scratch: &mut Vec<f32>, values: impl Iterator<Item = f32>) -> Option<f32> {
    scratch.clear();
    scratch.extend(values);
    let half = scratch.len().checked_sub(1)? / 2;
    Some(*scratch.select_nth_unstable_by(half, f32::total_cmp).1)
}

/// The box to look at for sample `i` of `requested`: one of each stretch, at a place that a hash
/// chooses, because scenes are often laid out in rows of some round number.
fn position(i: usize, requested: usize, n: usize) -> usize {
    let (start, end) = (i * n / requested, (i + 1) * n / requested);
    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
    start + hash as usize % (end - start).max(1)
}
