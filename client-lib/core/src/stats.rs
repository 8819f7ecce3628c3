//! What the plan knows of a scene: a few numbers from a sample of at most 96 boxes.

use crate::aabb::{Aabb, BoxClass};
use crate::floats;
use crate::precision::BoxSlice;
use crate::units::BoxCount;

/// Most boxes looked at: 8 µs, in scenes whose culling takes twenty times that or more. Large
/// scenes are the grid's unless they are of an odd shape, which few boxes show.
const SAMPLE_MOST: usize = 96;
/// Small scenes are sampled less, so that planning stays a small part of them.
const SAMPLE_LEAST: usize = 32;
/// One box in so many, between the two.
const SAMPLE_SHARE: usize = 32;
/// Fewest boxes that are worth a look: a look takes 3 µs and 64 boxes take 2, and below so many
/// the engines that come into question take about the same regardless of the scene.
const LOOK_BOXES: usize = 512;
/// Share of the boxes that a sweep's window holds in scenes of fewer than [`LOOK_BOXES`].
const UNSEEN_WINDOW_SHARE: f32 = 0.03;

/// Statistics of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneStats {
    /// Boxes, valid or not.
    pub n: BoxCount,
    /// Whether boxes were looked at. Where not, all but `n` and `last_pairs` is assumed.
    pub is_looked_at: bool,
    /// Share of the boxes that have a point.
    pub valid_share: f32,
    /// Median of the boxes' longest edges.
    pub median_size: f32,
    /// 90th percentile of the boxes' longest edges.
    pub large_size: f32,
    /// Share of the boxes that start within a box's extent, the least of the three axes: the window of a sweep.
    pub window_share: f32,
    /// Mean over the boxes of longest edge / shortest edge, at most 100.
    pub elongation: f32,
    /// Pairs of the last frame, if there was one.
    pub last_pairs: Option<u64>,
}

impl SceneStats {
    /// Looks at a scene, whose boxes may be in any form. Allocates nothing, and sees the same regardless of the
    /// floating-point flags of this thread.
    pub fn of<'a>(boxes: impl Into<BoxSlice<'a>>, last_pairs: Option<u64>) -> Self {
        let boxes = boxes.into();
        floats::with_default(|| Self::look(boxes, last_pairs))
    }

    fn look(boxes: BoxSlice<'_>, last_pairs: Option<u64>) -> Self {
        let n = boxes.len();
        let requested = sample_size(n);
        let mut sample = [Aabb::EMPTY; SAMPLE_MOST];
        let mut count = 0;
        for index in sample_indices(requested, n) {
            let Some(b) = boxes.get(index) else { continue };
            if b.class() == BoxClass::Valid {
                sample[count] = b;
                count += 1;
            }
        }
        let sample = &sample[..count];
        let (median_size, large_size) = sizes(sample);
        Self {
            n: BoxCount::new(u32::try_from(n).unwrap_or(u32::MAX)),
            is_looked_at: true,
            valid_share: count as f32 / requested.max(1) as f32,
            median_size,
            large_size,
            window_share: (0..3).map(|axis| window_share(sample, axis)).fold(1.0, f32::min),
            elongation: elongation(sample),
            last_pairs,
        }
    }

    /// Looks at a scene where the look is worth its time: not at so few boxes that culling them
    /// takes no longer. Allocates nothing.
    pub fn glance<'a>(boxes: impl Into<BoxSlice<'a>>, last_pairs: Option<u64>) -> Self {
        let boxes = boxes.into();
        match BoxCount::of_len(boxes.len()) {
            Some(n) if boxes.len() < LOOK_BOXES => Self::unseen(n, last_pairs),
            _ => Self::of(boxes, last_pairs),
        }
    }

    /// What is taken for granted of a scene without a look at its boxes: like boxes, evenly spread.
    /// Enough for few boxes, and for a plan that has no choice of engine.
    pub fn unseen(n: BoxCount, last_pairs: Option<u64>) -> Self {
        Self {
            n,
            is_looked_at: false,
            valid_share: 1.0,
            median_size: 1.0,
            large_size: 1.0,
            window_share: UNSEEN_WINDOW_SHARE,
            elongation: 1.0,
            last_pairs,
        }
    }

    /// A scene of which no engine of the CPU takes less time: what a look could show at best. The
    /// engines of a GPU go by the number of boxes and pairs alone.
    pub fn at_best(n: BoxCount, last_pairs: Option<u64>) -> Self {
        Self { valid_share: 0.0, window_share: 0.0, ..Self::unseen(n, last_pairs) }
    }

    /// Boxes, as work is counted.
    pub(crate) fn boxes(&self) -> f64 {
        f64::from(self.n.get())
    }

    /// Pairs to expect: those of the last frame, or about one a box.
    pub fn expected_pairs(&self) -> f64 {
        self.last_pairs.map_or_else(|| self.boxes(), |pairs| pairs as f64)
    }

    /// The same of an engine that has an order of its own, and none of another.
    pub(crate) fn ordered_pairs(&self, has_order: bool) -> f64 {
        if has_order { self.expected_pairs() } else { 0.0 }
    }
}

/// How many of `n` boxes are looked at.
fn sample_size(n: usize) -> usize {
    (n / SAMPLE_SHARE).clamp(SAMPLE_LEAST, SAMPLE_MOST).min(n)
}

/// The boxes to look at for samples 0 to `requested`, at most `n`: one of each stretch, at a place that a
/// hash chooses, because scenes are often laid out in rows of some round number.
pub(crate) fn sample_indices(requested: usize, n: usize) -> impl Iterator<Item = usize> {
    // Stretch i is `i * n / requested..(i + 1) * n / requested`, found without a division for each.
    let (len, rest) = (n / requested.max(1), n % requested.max(1));
    let (mut start, mut carried) = (0, 0);
    (1..=requested as u64).map(move |i| {
        carried += rest;
        let longer = carried >= requested;
        carried -= if longer { requested } else { 0 };
        let stretch = start..start + len + usize::from(longer);
        start = stretch.end;
        let hash = i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        stretch.start + hash as usize % stretch.len().max(1)
    })
}

/// Median and 90th percentile of the longest edges.
fn sizes(sample: &[Aabb]) -> (f32, f32) {
    let mut sizes = [0.0; SAMPLE_MOST];
    let sizes = &mut sizes[..sample.len()];
    for (size, b) in sizes.iter_mut().zip(sample) {
        *size = (0..3).map(|a| b.max[a] - b.min[a]).fold(0.0, f32::max);
    }
    let mut at = |share: f32| {
        let k = (sizes.len() as f32 * share) as usize;
        if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(k, f32::total_cmp).1 }
    };
    (at(0.5), at(0.9))
}

/// Mean share of boxes that start within a box's extent on an axis: the window of a sweep along it. Few boxes far away
/// have no say in it, unlike in a variance. Of at most [`SAMPLE_MOST`] boxes.
#[allow(clippy::needless_bitwise_bool)] // A branch would keep the loop from being compiled to SIMD.
fn window_share(sample: &[Aabb], axis: usize) -> f32 {
    // What stands behind the sample is in no window.
    let mut starts = [f32::NAN; SAMPLE_MOST];
    for (start, b) in starts.iter_mut().zip(sample) {
        *start = b.min[axis];
    }
    let mut windows = [0.0f32; SAMPLE_MOST];
    let windows = &mut windows[..sample.len()];
    for (window, b) in windows.iter_mut().zip(sample) {
        let (start, end) = (b.min[axis], b.max[axis]);
        // Those behind the start count twice: of two boxes that start together one is in the window of the other.
        let halves = starts.iter().map(|other| {
            let is_before_end = *other <= end;
            u32::from((*other >= start) & is_before_end)
                + u32::from((*other > start) & is_before_end)
        });
        *window = 0.5 * (halves.sum::<u32>() as f32 - 1.0);
    }
    if windows.is_empty() {
        return 0.0;
    }
    // One giant in a small sample would stand for a share of giants that the scene does not have.
    let large = windows.len() * 9 / 10;
    let most = 1.0 + 2.0 * *windows.select_nth_unstable_by(large, f32::total_cmp).1;
    let sum: f32 = windows.iter().map(|w| w.min(most)).sum();
    sum / (sample.len() * sample.len()) as f32
}

fn elongation(sample: &[Aabb]) -> f32 {
    let of = |b: &Aabb| {
        let edges: [f32; 3] = std::array::from_fn(|a| b.max[a] - b.min[a]);
        let longest = edges.iter().fold(0.0f32, |a, b| a.max(*b));
        let shortest = edges.iter().fold(f32::INFINITY, |a, b| a.min(*b));
        let ratio = longest / shortest;
        if ratio.is_nan() { 1.0 } else { ratio.min(100.0) }
    };
    sample.iter().map(of).sum::<f32>() / sample.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_boxes_and_no_valid_boxes_have_statistics() {
        for boxes in [vec![], vec![Aabb::EMPTY; 10]] {
            let stats = SceneStats::of(&boxes, None);
            assert_eq!(stats.valid_share, 0.0);
            assert!(stats.window_share <= 1.0 && stats.elongation.is_finite());
        }
    }

    #[test]
    fn infinite_boxes_leave_finite_statistics() {
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        let stats = SceneStats::of(&[all, Aabb::from([1.0, 2.0, 3.0, 2.0, 3.0, 4.0])], Some(1));
        assert!((0.0..=1.0).contains(&stats.window_share) && stats.elongation == 1.0);
        assert_eq!(stats.expected_pairs(), 1.0);
    }

    #[test]
    fn windows_are_measured_on_the_best_axis() {
        // A row of boxes along y, each of which holds the starts of the next 95.
        let boxes: Vec<Aabb> = (0..1000)
            .map(|i| Aabb::from([0.0, i as f32, 0.0, 1.0, i as f32 + 95.5, 1.0]))
            .collect();
        let stats = SceneStats::of(&boxes, None);
        assert!((0.06..0.12).contains(&stats.window_share), "{}", stats.window_share);
    }

    #[test]
    fn one_box_of_each_stretch_is_looked_at() {
        for n in [1, 2, 255, 256, 257, 1_000, 4_095, 4_097, 100_003] {
            for requested in [1, 2, 3, 100, 256, 1_000].map(|requested: usize| requested.min(n)) {
                let indices: Vec<usize> = sample_indices(requested, n).collect();
                assert_eq!(indices.len(), requested);
                for (i, index) in indices.into_iter().enumerate() {
                    let (start, end) = (i * n / requested, (i + 1) * n / requested);
                    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
                    assert_eq!(index, start + hash as usize % (end - start));
                }
            }
        }
        assert_eq!(sample_indices(0, 0).count(), 0);
    }
}
