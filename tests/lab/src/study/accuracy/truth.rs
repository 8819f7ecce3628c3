//! The right pairs of a scene, found in another way than the answers that are checked.

use pairmask::{Backend, Session};
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::{Pair, truth};
use pairmask_core::{Aabb, EngineChoice, EngineName};
use pairmaskd::timed_client::TimedError;
use serde::Serialize;

use crate::stress::absent;

/// Most boxes that are compared each with each: 8 million comparisons take some 10 ms.
pub const NAIVE_LIMIT: usize = 4096;

/// The engine that checks larger scenes, and the one that checks that engine.
const CHECKERS: [EngineName; 2] = [EngineName::CpuSap, EngineName::CpuGrid];

/// The overlapping pairs, sorted. Small scenes are compared naively, each box with each, as f64;
/// large ones go through an exact engine that is not `checked`.
pub fn pairs(boxes: &[Aabb], checked: EngineId) -> Result<Vec<Pair>, TimedError> {
    if boxes.len() <= NAIVE_LIMIT {
        return Ok(truth(boxes).pairs);
    }
    let engine = CHECKERS.into_iter().find(|e| checked != *e).unwrap_or(EngineName::CpuBrute);
    let builder = Session::builder().backend(Backend::InProcess).engine(EngineChoice::Only(engine));
    let mut session = builder.connect().map_err(pairmask::Error::from)?;
    let mut frame = session.frame(boxes.len())?;
    frame.boxes_mut().copy_from_slice(boxes);
    let mut pairs = frame.submit()?.wait()?.to_vec();
    pairs.sort_unstable();
    Ok(pairs)
}

/// The f32 one step outward of the nearest one: beyond `x` on that side, or `x` at infinity. For
/// boxes that give the candidates of an exact test.
pub fn outward(x: f64, up: bool) -> f32 {
    let nearest = x as f32;
    if up { nearest.next_up() } else { nearest.next_down() }
}

/// Counts of the pairs that a sorted list lacks and of those that it has too many.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    pub true_pairs: u64,
    pub missed: u64,
    pub extra: u64,
    /// `extra / true_pairs`, where that is a number.
    pub extra_ratio: Option<f64>,
}

impl Difference {
    pub const NONE: Self = Self { true_pairs: 0, missed: 0, extra: 0, extra_ratio: Some(0.0) };

    pub fn of(true_pairs: u64, missed: u64, extra: u64) -> Self {
        let ratio = (true_pairs > 0).then(|| extra as f64 / true_pairs as f64);
        Self { true_pairs, missed, extra, extra_ratio: if extra == 0 { Some(0.0) } else { ratio } }
    }

    pub fn between(reported: &[Pair], truth: &[Pair]) -> Self {
        let missed = absent(truth, reported).count() as u64;
        let true_pairs = truth.len() as u64;
        Self::of(true_pairs, missed, reported.len() as u64 + missed - true_pairs)
    }

    pub fn add(&mut self, other: &Self) {
        *self = Self::of(
            self.true_pairs + other.true_pairs,
            self.missed + other.missed,
            self.extra + other.extra,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_counted_and_outward_is_beyond() {
        let truth = [[0, 1], [0, 2], [4, 5]];
        let count = |reported: &[Pair]| {
            let found = Difference::between(reported, &truth);
            assert_eq!(found.true_pairs, 3);
            (found.missed, found.extra)
        };
        assert_eq!(Difference::of(0, 0, 0), Difference::NONE);
        let ratio = |extra| Difference::of(10 - extra, 0, extra).extra_ratio;
        assert_eq!((ratio(10), ratio(5)), (None, Some(1.0)));
        assert_eq!(count(&truth), (0, 0));
        assert_eq!(count(&[]), (3, 0));
        assert_eq!(count(&[[0, 1], [0, 3], [4, 5]]), (1, 1));
        assert_eq!(count(&[[0, 0], [0, 1], [0, 2], [4, 5], [9, 10]]), (0, 2));
        for x in [0.0, 1.0, -1.0 / 3.0, 1e-300, 1e300, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(f64::from(outward(x, false)) <= x && x <= f64::from(outward(x, true)), "{x}");
        }
        assert!(outward(1.0, true) > 1.0 && outward(1.0, false) < 1.0);
    }
}
