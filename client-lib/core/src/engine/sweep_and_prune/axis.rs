//! The sweep axis: where fewest boxes are in a window.

use crate::aabb::{Aabb, KeyBox};
use crate::engine::AvailableIsa;
use crate::simd::{MOST_LANES, per_isa};
use crate::stats::sample_indices;

/// Pairs of sampled boxes for each box of a scene: windows of 16 boxes, one step of the sweep, show as 16 pairs among
/// them.
const SAMPLED_PAIRS_A_BOX: usize = 2;
/// Boxes that are sampled. All three axes take .7 µs with 32 of them, 2 with 70, and 10 with 256 (AVX-512).
const SAMPLE_LEAST: usize = 32;
const SAMPLE_MOST: usize = 256;
/// The windows of an axis are shorter than another's by more than chance if they have a fifth fewer pairs, but for so many.
/// Boxes that move a little choose the same axis then, so that their order is nearly that of the last frame.
const BY_CHANCE: u32 = 16;

/// The axis along which fewest sampled boxes start within another; the first of those that differ by no more than chance. A
/// variance would follow few boxes far away, or few places far apart. Of the same boxes it is the same axis, so that the
/// reply is the same.
pub(super) fn sweep_axis(boxes: &[Aabb], isa: AvailableIsa) -> usize {
    let n = boxes.len();
    let requested = (SAMPLED_PAIRS_A_BOX * n).isqrt().clamp(SAMPLE_LEAST, SAMPLE_MOST).min(n);
    let mut starts = [[KeyBox::NOTHING.min[0]; SAMPLE_MOST]; 3];
    let mut ends = [[KeyBox::NOTHING.max[0]; SAMPLE_MOST]; 3];
    for (at, index) in sample_indices(requested, n).enumerate() {
        let key = KeyBox::from(&boxes[index]);
        for axis in 0..3 {
            (starts[axis][at], ends[axis][at]) = (key.min[axis], key.max[axis]);
        }
    }
    let valid = starts[0].iter().filter(|start| **start != KeyBox::NOTHING.min[0]).count() as u32;
    let windows = [0, 1, 2].map(|axis| {
        // Of two boxes each starts before the end of the other where they overlap, and else one of them: so often too,
        // and of each box with itself.
        let before_ends = starts_before_ends(&starts[axis], &ends[axis], requested, isa);
        before_ends - valid * (valid + 1) / 2
    });
    let is_shorter = |one: usize, other: usize| 5 * (windows[one] + BY_CHANCE) < 4 * windows[other];
    (1..3).fold(0, |best, axis| if is_shorter(axis, best) { axis } else { best })
}

per_isa! {
    /// How often one of `count` starts is no greater than one of as many ends.
    fn starts_before_ends<simd: S>(
        starts: &[i32; SAMPLE_MOST],
        ends: &[i32; SAMPLE_MOST],
        count: usize,
    ) -> u32 {
        let _ = simd;
        // Whole registers: what stands behind overlaps nothing.
        let padded = &starts[..count.next_multiple_of(MOST_LANES).min(SAMPLE_MOST)];
        let mut sum = 0;
        for end in &ends[..count] {
            sum += padded.iter().map(|start| u32::from(start <= end)).sum::<u32>();
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boxes along x, which all overlap on the other axes.
    fn line(n: usize) -> Vec<Aabb> {
        let at = |i: usize| [3.0 * i as f32, 0.3 * (i % 7) as f32, 0.3 * (i % 5) as f32];
        (0..n).map(at).map(|min| Aabb::new(min, min.map(|x| x + 2.0))).collect()
    }

    #[test]
    fn a_few_boxes_far_away_choose_no_axis() {
        let n = 4_000;
        for far in [1e6, 1e9, 1e30, f32::INFINITY] {
            let mut boxes = line(n);
            assert_eq!(sweep_axis(&boxes, AvailableIsa::best()), 0);
            for (i, b) in boxes.iter_mut().step_by(200).enumerate() {
                let y = if i % 2 == 0 { far } else { -far };
                *b = Aabb::new([b.min[0], y, y], [b.max[0], y, y]);
            }
            assert_eq!(sweep_axis(&boxes, AvailableIsa::best()), 0, "{far}");
        }
    }

    #[test]
    fn a_few_places_choose_no_axis() {
        let mut boxes = line(4_000);
        for (i, b) in boxes.iter_mut().enumerate() {
            let apart = [1e7, 3e7, -2e7][i % 3];
            (b.min[2], b.max[2]) = (b.min[2] + apart, b.max[2] + apart);
        }
        assert_eq!(sweep_axis(&boxes, AvailableIsa::best()), 0);
    }

    #[test]
    fn short_windows_are_distinguished() {
        let n = 20_000;
        let boxes: Vec<Aabb> = (0..n)
            .map(|i| {
                // A window of one box on x, of 33 on y, and of all on z.
                let y = [0.0, 1e7, -1e7][i % 3] + (i * 7_919 % n) as f32;
                Aabb::new([i as f32, y, 0.0], [i as f32 + 0.5, y + 100.0, 1.0])
            })
            .collect();
        assert_eq!(sweep_axis(&boxes, AvailableIsa::best()), 0);
    }
}
