//! The sweep axis: where fewest boxes are in a window.

use crate::aabb::{Aabb, BoxClass};
use crate::engine::AvailableIsa;
use crate::floats;
use crate::simd::{MOST_LANES, per_isa};
use crate::stats::{halves_of_window, sample_indices};

/// Boxes that are sampled: as many as show windows of 16 boxes, one step of the sweep, by some 30 of them; the most for
/// large scenes, and the least. To compare them with one another takes a twentieth of a frame with AVX-512.
const SAMPLE_MOST: usize = 256;
const SAMPLE_LEAST: usize = 32;
/// Pairs of sampled boxes for each box of a scene.
const SAMPLED_PAIRS_A_BOX: usize = 2;

/// The axis along which fewest sampled boxes start within the extent of another. A variance would follow few boxes far away,
/// and the distance of few places. Of the same boxes it is the same axis, regardless of the flags of this thread, so
/// that the reply is the same.
pub(super) fn sweep_axis(boxes: &[Aabb], isa: AvailableIsa) -> usize {
    let n = boxes.len();
    let requested = (SAMPLED_PAIRS_A_BOX * n).isqrt().clamp(SAMPLE_LEAST, SAMPLE_MOST).min(n);
    // What stands behind the sample is in no window.
    let mut starts = [[f32::NAN; SAMPLE_MOST]; 3];
    let mut ends = starts;
    floats::with_default(|| {
        let sample = sample_indices(requested, n).map(|index| boxes[index]);
        let valid = sample.filter(|b| b.class() == BoxClass::Valid);
        let mut count = 0;
        for b in valid {
            for axis in 0..3 {
                (starts[axis][count], ends[axis][count]) = (b.min[axis], b.max[axis]);
            }
            count += 1;
        }
        let windows = [0, 1, 2].map(|axis| in_windows(&starts[axis], &ends[axis], count, isa));
        (1..3).fold(0, |a, b| if windows[b] < windows[a] { b } else { a })
    })
}

per_isa! {
    /// Boxes in the windows of `count` intervals, each counted as two halves.
    fn in_windows<simd: S>(
        starts: &[f32; SAMPLE_MOST],
        ends: &[f32; SAMPLE_MOST],
        count: usize,
    ) -> u32 {
        let _ = simd;
        // Whole registers.
        let padded = &starts[..count.next_multiple_of(MOST_LANES).min(SAMPLE_MOST)];
        let mut sum = 0;
        for (start, end) in starts[..count].iter().zip(&ends[..count]) {
            sum += halves_of_window(padded, *start, *end);
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
