//! The demo's own check: it compares every pair, by the oracle.

use std::fmt;

use pairmask_core::Aabb;
use pairmask_core::oracle::truth;

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

/// The first pair, in order, that an answer gets wrong.
pub fn first_bad_pair(boxes: &[Aabb], mut answer: Vec<(u32, u32)>) -> Option<BadPair> {
    answer.sort_unstable();
    let mut right = truth(boxes).pairs.into_iter();
    for (a, b) in answer {
        match right.next() {
            Some(pair) if pair == (a, b) => {}
            Some((c, d)) if (c, d) < (a, b) => return Some(BadPair::Missing(c, d)),
            _ => return Some(BadPair::Extra(a, b)),
        }
    }
    right.next().map(|(a, b)| BadPair::Missing(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, SceneName};

    #[test]
    fn notices_one_pair_too_few_or_too_many() {
        let scene = Scene::new(SceneName::Uniform, 345, 7);
        let boxes = scene.boxes();
        let right = truth(boxes).pairs;
        assert!(right.len() > 100, "{} pairs", right.len());
        let backwards = right.iter().rev().copied().collect();
        assert_eq!(first_bad_pair(boxes, backwards), None, "the order does not matter");
        for (at, (a, b)) in right.iter().enumerate() {
            let mut less = right.clone();
            less.remove(at);
            assert_eq!(first_bad_pair(boxes, less), Some(BadPair::Missing(*a, *b)));
            let twice = [&right[..], &[(*a, *b)]].concat();
            assert_eq!(first_bad_pair(boxes, twice), Some(BadPair::Extra(*a, *b)));
        }
        let more = [&right[..], &[(0, 345)]].concat();
        assert!(first_bad_pair(boxes, more).is_some());
    }
}
