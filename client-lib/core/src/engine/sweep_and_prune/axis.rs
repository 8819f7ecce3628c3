//! The sweep axis: where the boxes are spread widest.

use crate::aabb::order_key;
use crate::engine::KeyColumns;
use crate::floats;

/// Boxes looked at: the spread is a rough guide, and any axis gives the same pairs.
const SAMPLE: usize = 1_024;

/// Boxes whose keys become coordinates together, a register at a time.
const BLOCK: usize = 64;

/// The axis with the largest variance of min coordinates against the mean edge: there the fewest
/// boxes are in a window. Infinite coordinates do not count. Of the same boxes it is the same axis,
/// regardless of the flags of this thread, so that the reply is the same.
pub(super) fn widest(columns: &KeyColumns) -> usize {
    floats::with_default(|| {
        let spreads = spreads(columns);
        (0..3).fold(0, |widest, axis| if spreads[axis] > spreads[widest] { axis } else { widest })
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
