//! How a scene is swept: the axis of the sort, and the tubes along the other two. Pure.

use pairmask_core::Aabb;

use super::layouts::{DIGIT_BITS, SweepParams};

/// Boxes that are looked at.
const LOOK: usize = 256;
/// Bits of a place, at the most: numbers up to there are f32 exactly.
const PLACE_BITS_MOST: u32 = 24;
/// Bits by which places outnumber the boxes of a tube: few of them share a place.
const PLACE_BITS_TO_SPARE: u32 = 3;
/// Bits of a tube's number along an axis, at the most.
const TUBE_BITS_MOST: u32 = 6;
/// Boxes that a box is to find on its stretch of a tube. Fewer tubes leave more; with more of them more boxes lie in
/// several.
const STRETCH: f64 = 16.0;
/// Least width of a tube, in mean boxes: then one box in four lies in two.
const TUBE_WIDTH: f64 = 4.0;

/// Axis, tubes and places of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPlan {
    /// The axis of the sort, and the other two.
    pub axes: [usize; 3],
    /// Bits of a place, and of a tube's number along the other two axes.
    pub bits: [u32; 3],
    /// Where places and tubes begin.
    pub origins: [f32; 3],
    /// How many of them a unit has.
    pub scales: [f32; 3],
}

/// Places beyond the boxes that the look saw, on either side, as a part of their spread: it leaves out one in fifty
/// of a side, and sees 256.
const MARGIN: f64 = 0.0625;

/// What the look saw along an axis.
#[derive(Clone, Copy, Debug)]
struct Spread {
    axis: usize,
    low: f64,
    width: f64,
    mean_box: f64,
}

impl Spread {
    fn of(boxes: &[Aabb], axis: usize) -> Self {
        let step = (boxes.len() / LOOK).max(1);
        let seen = boxes.iter().step_by(step);
        let usable = seen.filter(|b| {
            let (low, high) = (b.min[axis], b.max[axis]);
            low.is_finite() && high.is_finite() && low <= high
        });
        let mut ends: Vec<[f64; 2]> =
            usable.map(|b| [b.min[axis], b.max[axis]].map(f64::from)).collect();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        // Without the outermost, which may be far off: boxes beyond the margin share the first place, or the last.
        let inner = &ends[ends.len() / 50..ends.len() - ends.len() / 50];
        let [Some(first), Some(last)] = [inner.first(), inner.last()] else {
            return Self { axis, low: 0.0, width: 1.0, mean_box: 1.0 };
        };
        let mean_box = inner.iter().map(|[low, high]| high - low).sum::<f64>() / inner.len() as f64;
        let seen = last[0] - first[0];
        let width = (1.0 + 2.0 * MARGIN) * seen + mean_box;
        // Boxes without any width, all in one place, still need a scale.
        let width = width.max(1e-18);
        Self { axis, low: first[0] - MARGIN * seen, width, mean_box }
    }

    /// Share of the boxes that a box reaches along this axis.
    fn reach(&self) -> f64 {
        (self.mean_box / self.width).min(1.0)
    }
}

impl SweepPlan {
    /// The plan for a scene, by a look at 256 boxes: the sort is along the axis on which a box reaches the fewest
    /// others, and tubes divide the rest until a box finds about sixteen.
    pub fn of(boxes: &[Aabb]) -> Self {
        let mut spreads = [0, 1, 2].map(|axis| Spread::of(boxes, axis));
        spreads.sort_by(|a, b| a.reach().total_cmp(&b.reach()));
        let n = boxes.len().max(1) as f64;
        let mut wanted = (n * spreads[0].reach() / STRETCH).log2().ceil().max(0.0) as u32;
        let mut bits = [0; 3];
        for (bits, spread) in bits.iter_mut().zip(&spreads).skip(1) {
            let tubes = (spread.width / (TUBE_WIDTH * spread.mean_box)).max(1.0);
            *bits = (tubes.log2() as u32).min(TUBE_BITS_MOST).min(wanted);
            wanted -= *bits;
        }
        Self::with_tubes(boxes.len(), spreads, [bits[1], bits[2]])
    }

    fn with_tubes(n: usize, spreads: [Spread; 3], tubes: [u32; 2]) -> Self {
        let of_boxes = usize::BITS - n.leading_zeros() + PLACE_BITS_TO_SPARE;
        let places = of_boxes.saturating_sub(tubes[0] + tubes[1]);
        let bits = [
            places.clamp(2 * DIGIT_BITS, PLACE_BITS_MOST.min(32 - tubes[0] - tubes[1])),
            tubes[0],
            tubes[1],
        ];
        let scale = |i: usize| (f64::from(1u32 << bits[i]) / spreads[i].width) as f32;
        Self {
            axes: spreads.map(|spread| spread.axis),
            bits,
            origins: spreads.map(|spread| spread.low as f32),
            scales: std::array::from_fn(scale),
        }
    }

    /// The same with half as many tubes; `None` where there is one.
    pub fn with_fewer_tubes(mut self) -> Option<Self> {
        let largest = if self.bits[1] >= self.bits[2] { 1 } else { 2 };
        self.bits[largest] = self.bits[largest].checked_sub(1)?;
        self.scales[largest] /= 2.0;
        Some(self)
    }

    /// Bits of a key.
    pub const fn key_bits(&self) -> u32 {
        self.bits[0] + self.bits[1] + self.bits[2]
    }

    /// Passes of the sort.
    pub const fn passes(&self) -> u32 {
        self.key_bits().div_ceil(DIGIT_BITS)
    }

    /// What the stages are told of it.
    pub const fn params(&self) -> SweepParams {
        let [axis_0, axis_1, axis_2] = self.axes;
        SweepParams {
            n: 0,
            entry_capacity: 0,
            pair_capacity: 0,
            axes: axis_0 as u32 | (axis_1 as u32) << 8 | (axis_2 as u32) << 16,
            place_bits: self.bits[0],
            tube_bits_0: self.bits[1],
            tube_bits_1: self.bits[2],
            pass_number: 0,
            shift: 0,
            tiles: 0,
            thread_rounds: 0,
            origin_0: self.origins[0],
            origin_1: self.origins[1],
            origin_2: self.origins[2],
            scale_0: self.scales[0],
            scale_1: self.scales[1],
            scale_2: self.scales[2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(n: u32, at: impl Fn(u32) -> [f32; 3]) -> Vec<Aabb> {
        (0..n).map(|i| Aabb { min: at(i), max: at(i).map(|x| x + 1.0) }).collect()
    }

    #[test]
    fn a_line_is_sorted_along_itself_and_not_divided() {
        let line = boxes(10_000, |i| [0.0, i as f32, 0.0]);
        let plan = SweepPlan::of(&line);
        assert_eq!((plan.axes[0], plan.bits[1], plan.bits[2]), (1, 0, 0));
    }

    #[test]
    fn a_cube_is_divided_into_tubes_and_these_can_be_halved_to_one() {
        let side = 40;
        let cube =
            boxes(64_000, |i| [i % side, i / side % side, i / side / side].map(|x| 2.0 * x as f32));
        let mut plan = SweepPlan::of(&cube);
        assert!(plan.bits[1] + plan.bits[2] >= 4, "{plan:?}");
        let before = plan.key_bits();
        let mut halvings = 0;
        while let Some(fewer) = plan.with_fewer_tubes() {
            plan = fewer;
            halvings += 1;
        }
        assert_eq!((plan.bits[1], plan.bits[2], plan.key_bits() + halvings), (0, 0, before));
    }

    #[test]
    fn no_scene_is_beyond_a_key() {
        let nan = Aabb { min: [f32::NAN; 3], max: [f32::NAN; 3] };
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        let point = Aabb { min: [5.0; 3], max: [5.0; 3] };
        for scene in [vec![], vec![nan; 9], vec![all; 300], vec![point; 1], vec![point; 70_000]] {
            let plan = SweepPlan::of(&scene);
            assert!(plan.key_bits() <= 32 && plan.bits[0] <= PLACE_BITS_MOST, "{plan:?}");
            assert!(plan.scales.iter().all(|scale| scale.is_finite() && *scale > 0.0), "{plan:?}");
        }
    }
}
