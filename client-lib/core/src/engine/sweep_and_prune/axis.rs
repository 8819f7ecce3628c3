//! The sweep axis: where the boxes are spread widest.

use crate::aabb::order_key;
use crate::engine::KeyColumns;
use crate::floats;

/// Boxes looked at: the spread is a rough guide, and any axis gives the same pairs.
const SAMPLE: usize = 1_024;

/// The axis with the largest variance of min coordinates against the mean edge: there the fewest
/// boxes are in a window. Infinite coordinates do not count. Of the same boxes it is the same axis,
/// whatever the flags of this thread, so that the reply is the same.
pub(super) fn widest(columns: &KeyColumns) -> usize {
    floats::with_default(|| {
        let spreads: [f64; 3] = std::array::from_fn(|axis| spread(columns, axis));
        (0..3).fold(0, |widest, axis| if spreads[axis] > spreads[widest] { axis } else { widest })
    })
}

/// Standard deviation of the min coordinates in units of the mean edge.
fn spread(columns: &KeyColumns, axis: usize) -> f64 {
    let (min, max, n) = (columns.min(axis), columns.max(axis), columns.len());
    let coordinate = |key: i32| f64::from(f32::from_bits(order_key(key as u32) as u32));
    let (mut count, mut sum, mut squares, mut edges) = (0.0, 0.0, 0.0, 0.0);
    for i in (0..n).step_by(n.div_ceil(SAMPLE).max(1)) {
        let (low, high) = (coordinate(min[i]), coordinate(max[i]));
        if low.is_finite() && high.is_finite() {
            count += 1.0;
            sum += low;
            squares += low * low;
            edges += high - low;
        }
    }
    if count == 0.0 {
        return 0.0;
    }
    let mean = sum / count;
    let deviation = (squares / count - mean * mean).max(0.0).sqrt();
    deviation / (edges / count).max(f64::MIN_POSITIVE)
}
