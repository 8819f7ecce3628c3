//! The sweep axis: where fewest boxes are in a window.

use crate::aabb::{Aabb, KeyBox, coordinate, order_key};
use crate::engine::KeyColumns;
use crate::floats;
use crate::stats::{SAMPLE_MOST, sample_indices, sample_size, window_share};

/// Boxes looked at: the spread is a rough guide, and any axis gives the same pairs.
const SAMPLE: usize = 1_024;

/// Boxes whose keys become coordinates together, a register at a time.
const BLOCK: usize = 64;

/// Boxes of scenes whose windows are sampled too: that takes 4 to 17 µs, at most a tenth of a frame of so many.
const WINDOWED: usize = 1_024;
/// A window is shorter than another by more than chance if it is less than half as long, but for so many sampled boxes.
const BY_CHANCE: f32 = 3.0;

/// The axis along which fewest boxes are in a window: that with the largest variance of min coordinates against the
/// mean edge, where infinite coordinates do not count; but one whose windows are much shorter among sampled boxes, since a
/// few boxes far away, or a few places, make a variance too. Of the same boxes it is the same axis, regardless of the
/// flags of this thread, so that the reply is the same.
pub(super) fn sweep_axis(columns: &KeyColumns) -> usize {
    floats::with_default(|| {
        let spreads = spreads(columns);
        let widest = (1..3).fold(0, |a, b| if spreads[b] > spreads[a] { b } else { a });
        if columns.len() < WINDOWED {
            return widest;
        }
        let mut sample = [Aabb::EMPTY; SAMPLE_MOST];
        let mut count = 0;
        for index in sample_indices(sample_size(columns.len()), columns.len()) {
            let min = [0, 1, 2].map(|axis| columns.min(axis)[index]);
            let max = [0, 1, 2].map(|axis| columns.max(axis)[index]);
            if min != KeyBox::NOTHING.min {
                sample[count] = Aabb { min: min.map(coordinate), max: max.map(coordinate) };
                count += 1;
            }
        }
        let windows = [0, 1, 2].map(|axis| window_share(&sample[..count], axis));
        let shortest = (1..3).fold(0, |a, b| if windows[b] < windows[a] { b } else { a });
        let by_chance = BY_CHANCE / count.max(1) as f32;
        if windows[widest] > 2.0 * windows[shortest] + by_chance { shortest } else { widest }
    })
}

/// Standard deviation of the min coordinates on each axis, in units of the mean edge.
fn spreads(columns: &KeyColumns) -> [f64; 3] {
    let n = columns.len();
    let step = n.div_ceil(SAMPLE).max(1);
    let mut sums = [Sums::default(); 3];
    let mut blocks = [Intervals { lows: [0.0; BLOCK], highs: [0.0; BLOCK] }; 3];
    for first in (0..n).step_by(step * BLOCK) {
        let len = (n - first).div_ceil(step).min(BLOCK);
        for (axis, (block, sums)) in blocks.iter_mut().zip(&mut sums).enumerate() {
            let keys = [columns.min(axis), columns.max(axis)];
            sums.count += block.take(keys.map(|keys| &keys[first..n]), step, len);
        }
        // The axes side by side, because each sum waits for its last addition.
        for i in 0..len {
            for (sums, block) in sums.iter_mut().zip(&blocks) {
                sums.add(f64::from(block.lows[i]), f64::from(block.highs[i]));
            }
        }
    }
    sums.map(|sums| sums.spread())
}

#[derive(Clone, Copy)]
struct Intervals {
    lows: [f32; BLOCK],
    highs: [f32; BLOCK],
}

impl Intervals {
    /// Every `step`-th interval, `len` of them, with 0 for those that are not finite. Returns how many are.
    fn take(&mut self, [min, max]: [&[i32]; 2], step: usize, len: usize) -> u32 {
        let mut keys = [[0; BLOCK]; 2];
        for (block, keys) in keys.iter_mut().zip([min, max]) {
            if step == 1 {
                block[..len].copy_from_slice(&keys[..len]);
            } else {
                block[..len]
                    .iter_mut()
                    .zip(keys.iter().step_by(step))
                    .for_each(|(to, key)| *to = *key);
            }
        }
        let mut not_finite = 0;
        for i in 0..BLOCK {
            let [low, high] = [keys[0][i], keys[1][i]].map(|key| order_key(key as u32));
            let finite = is_finite(low) & is_finite(high);
            not_finite += u32::from(!finite);
            self.lows[i] = f32::from_bits(if finite { low as u32 } else { 0 });
            self.highs[i] = f32::from_bits(if finite { high as u32 } else { 0 });
        }
        // What stands behind the intervals is finite.
        len as u32 - not_finite
    }
}

/// Whether a number with these bits is neither infinite nor a NaN.
#[inline(always)]
fn is_finite(bits: i32) -> bool {
    bits & i32::MAX < f32::INFINITY.to_bits() as i32
}

/// Sums over the finite intervals of an axis.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: u32,
    mins: f64,
    squares: f64,
    edges: f64,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, low: f64, high: f64) {
        self.mins += low;
        self.squares += low * low;
        self.edges += high - low;
    }

    fn spread(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let count = f64::from(self.count);
        let mean = self.mins / count;
        let deviation = (self.squares / count - mean * mean).max(0.0).sqrt();
        deviation / (self.edges / count).max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Cancel;
    use crate::isa::AvailableIsa;

    fn axis_of(boxes: &[Aabb]) -> usize {
        let mut columns = KeyColumns::default();
        let _ = columns.ingest(boxes, AvailableIsa::best(), &Cancel::never());
        sweep_axis(&columns)
    }

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
            assert_eq!(axis_of(&boxes), 0);
            for (i, b) in boxes.iter_mut().step_by(200).enumerate() {
                let y = if i % 2 == 0 { far } else { -far };
                *b = Aabb::new([b.min[0], y, y], [b.max[0], y, y]);
            }
            assert_eq!(axis_of(&boxes), 0, "{far}");
        }
    }

    #[test]
    fn a_few_places_choose_no_axis() {
        let mut boxes = line(4_000);
        for (i, b) in boxes.iter_mut().enumerate() {
            let apart = [1e7, 3e7, -2e7][i % 3];
            (b.min[2], b.max[2]) = (b.min[2] + apart, b.max[2] + apart);
        }
        assert_eq!(axis_of(&boxes), 0);
    }
}
