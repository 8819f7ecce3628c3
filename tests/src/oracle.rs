//! The one naive oracle: two loops, one comparison, no keys, no SIMD, no index formula.
//!
//! It shares no code with the engines beyond the layout of a box. It compares f64: every f32 is one
//! exactly, and the smallest f32 subnormal is a normal f64, so that no CPU mode can flush it.

use pairmask::Aabb;
use pairmask::engine::{Census, NAMED_INVALID};

/// A pair of box indices, the lower one first.
pub type Pair = (u32, u32);

/// What the answer to a scene is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Truth {
    /// Overlapping pairs, sorted.
    pub pairs: Vec<Pair>,
    /// Boxes that overlap nothing by their own fault.
    pub census: Census,
}

/// The answer for `boxes`, by comparing every box with every other.
///
/// ```
/// use pairmask::Aabb;
/// let boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 3];
/// assert_eq!(pairmask_tests::oracle::truth(&boxes).pairs, [(0, 1), (0, 2), (1, 2)]);
/// ```
///
/// # Panics
/// With 2^32 boxes or more.
pub fn truth(boxes: &[Aabb]) -> Truth {
    let n = u32::try_from(boxes.len()).expect("indices are u32");
    let solid: Vec<Option<[[f64; 3]; 2]>> = boxes.iter().map(solid).collect();
    let mut pairs = Vec::new();
    for a in 0..n {
        for b in a + 1..n {
            if let (Some(p), Some(q)) = (&solid[a as usize], &solid[b as usize])
                && (0..3).all(|axis| p[0][axis] <= q[1][axis] && q[0][axis] <= p[1][axis])
            {
                pairs.push((a, b));
            }
        }
    }
    Truth { pairs, census: census(boxes) }
}

/// Corners of a box, unless it is invalid or empty.
fn solid(b: &Aabb) -> Option<[[f64; 3]; 2]> {
    let [min, max] = [b.min.map(f64::from), b.max.map(f64::from)];
    (0..3).all(|axis| min[axis] <= max[axis]).then_some([min, max])
}

fn census(boxes: &[Aabb]) -> Census {
    let is_invalid = |b: &&Aabb| b.min.iter().chain(&b.max).any(|x| x.is_nan());
    let invalid: Vec<u32> =
        (0u32..).zip(boxes).filter(|(_, b)| is_invalid(b)).map(|(i, _)| i).collect();
    let empty = boxes.iter().filter(|b| !is_invalid(b) && solid(b).is_none()).count();
    let mut first_invalid = [0; NAMED_INVALID];
    for (slot, index) in first_invalid.iter_mut().zip(&invalid) {
        *slot = *index;
    }
    Census { invalid: invalid.len() as u32, empty: empty as u32, first_invalid }
}

/// FNV-1a (Fowler, Noll, Vo; 64 bits) over the pairs as little-endian u32: a fingerprint that is
/// the same on every machine and with every compiler.
pub fn pair_set_hash(pairs: &[Pair]) -> u64 {
    let bytes = pairs.iter().flat_map(|&(a, b)| [a, b]).flat_map(u32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rules_of_the_wire_hold() {
        let unit = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        let touching = Aabb::from([1.0, -0.0, -0.0, 2.0, 1.0, 1.0]);
        let apart = Aabb::from([1.0f32.next_up(), 0.0, 0.0, 2.0, 1.0, 1.0]);
        let plane = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        let mut invalid = Aabb::EMPTY;
        invalid.min[2] = f32::NAN;
        let boxes = [unit, touching, apart, plane, Aabb::EMPTY, invalid];
        let truth = truth(&boxes);
        assert_eq!(truth.pairs, [(0, 1), (0, 3), (1, 2), (1, 3), (2, 3)]);
        assert_eq!((truth.census.empty, truth.census.invalid), (1, 1));
        assert_eq!(truth.census.named_invalid(), [5]);
    }

    #[test]
    fn the_oracle_agrees_with_the_box_type_on_single_pairs() {
        for scene in crate::stress_scenes::ALL {
            let boxes = scene.boxes(24, 7);
            let pairs = truth(&boxes).pairs;
            for a in 0..boxes.len() {
                for b in a + 1..boxes.len() {
                    let listed = pairs.binary_search(&(a as u32, b as u32)).is_ok();
                    assert_eq!(boxes[a].overlaps(&boxes[b]), listed, "{scene:?} ({a}, {b})");
                }
            }
        }
    }

    #[test]
    fn the_hash_tells_sets_apart() {
        assert_eq!(pair_set_hash(&[]), 0xcbf2_9ce4_8422_2325);
        assert_ne!(pair_set_hash(&[(0, 1)]), pair_set_hash(&[(0, 2)]));
        assert_ne!(pair_set_hash(&[(0, 1), (0, 2)]), pair_set_hash(&[(0, 1)]));
    }
}
