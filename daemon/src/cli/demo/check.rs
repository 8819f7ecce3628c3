//! The demo's own check: it compares every pair by the definition of overlap.

use std::fmt;

use pairmask_core::Aabb;

/// A pair that an answer gets wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadPair {
    /// The boxes overlap and the answer lacks the pair.
    Missing(u32, u32),
    /// The answer has the pair and the boxes do not overlap, or it has the pair twice.
    Extra(u32, u32),
}

impl fmt::Display for BadPair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing(a, b) => write!(f, "pair ({a}, {b}) is missing"),
            Self::Extra(a, b) => write!(f, "pair ({a}, {b}) is not one, or named twice"),
        }
    }
}

/// Closed overlap of boxes without NaN, in floats: the check shares no code with the engines, which
/// compare integer keys. An empty box overlaps nothing, since it does not even overlap itself.
fn overlap(a: &Aabb, b: &Aabb) -> bool {
    let meet = |p: &Aabb, q: &Aabb| (0..3).all(|x| p.min[x] <= q.max[x] && q.min[x] <= p.max[x]);
    meet(a, b) && meet(a, a) && meet(b, b)
}

/// The first pair, in order, that an answer gets wrong. Compares all n(n − 1)/2.
pub fn first_bad_pair(boxes: &[Aabb], mut answer: Vec<(u32, u32)>) -> Option<BadPair> {
    answer.sort_unstable();
    let mut answered = answer.into_iter().peekable();
    for (a, box_a) in (0u32..).zip(boxes) {
        for (b, box_b) in (a + 1..).zip(&boxes[a as usize + 1..]) {
            match (overlap(box_a, box_b), answered.next_if_eq(&(a, b)).is_some()) {
                (true, false) => return Some(BadPair::Missing(a, b)),
                (false, true) => return Some(BadPair::Extra(a, b)),
                _ => {}
            }
        }
    }
    // A pair that is left was not reached in order: it is a duplicate, reversed, or names no box.
    answered.next().map(|(a, b)| BadPair::Extra(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, SceneName};

    #[test]
    fn notices_one_pair_too_few_or_too_many() {
        let scene = Scene::new(SceneName::Uniform, 345, 7);
        let boxes = scene.boxes();
        let mut right = Vec::new();
        for a in 0..boxes.len() {
            for b in a + 1..boxes.len() {
                if boxes[a].overlaps(&boxes[b]) {
                    right.push((a as u32, b as u32));
                }
            }
        }
        assert!(right.len() > 100, "{} pairs", right.len());
        let backwards = right.iter().rev().copied().collect();
        assert_eq!(first_bad_pair(boxes, backwards), None, "the order does not matter");
        for i in 0..right.len() {
            let (a, b) = right[i];
            let mut less = right.clone();
            less.remove(i);
            assert_eq!(first_bad_pair(boxes, less), Some(BadPair::Missing(a, b)));
            let mut twice = right.clone();
            twice.push((a, b));
            assert!(matches!(
                first_bad_pair(boxes, twice),
                Some(BadPair::Extra(..) | BadPair::Missing(..))
            ));
        }
        let mut more = right.clone();
        more.push((0, 345));
        assert!(first_bad_pair(boxes, more).is_some());
    }

    #[test]
    fn empty_boxes_overlap_nothing() {
        let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
        let mut inside_out = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        inside_out.min[1] = 2.0;
        assert_eq!(first_bad_pair(&[all, inside_out, Aabb::EMPTY], vec![]), None);
    }
}
