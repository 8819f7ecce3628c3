//! Compares the extra pairs of an answer with the gap that the mode states.
//!
//! A mode may report pairs that do not overlap, and states how far apart those may be
//! ([`Widening::gap_limit`], [`Margin::gap_limit`](pairmask_core::precision::Margin::gap_limit)). So the real
//! gap of each extra pair is measured on each axis, without rounding: none may be above the stated one.

use pairmask_core::oracle::{Faces, Pair};
use pairmask_core::precision::Widening;

use super::modes::{ModeCase, Sending};
use super::subject::{Finding, absent};

/// The stated gap of a mode: the largest on an axis, given where one box ends and the other starts.
pub(super) type Stated<'a> = dyn Fn(usize, f64, f64) -> f64 + 'a;

/// An extra pair with a larger gap than stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TooFar {
    pub pair: Pair,
    pub axis: usize,
    /// The gap, rounded, for messages.
    pub gap: f64,
    pub stated: f64,
}

/// Compares the extra pairs of an answer with the gap that the case's mode states.
pub(super) fn check(case: &ModeCase, got: &[Pair]) -> Result<(), Finding> {
    let extra = absent(got, &case.allowed.must.pairs);
    let far = match &case.sending {
        Sending::Narrow(precision) => {
            let widening = precision.widening();
            too_far(case, extra, &|axis, ends, starts| widening.gap_limit(axis, ends, starts))
        }
        Sending::Inflated(margin) => too_far(case, extra, &|axis, ends, starts| {
            margin.gap_limit(&Widening::None, axis, ends, starts)
        }),
        Sending::World { origin, .. } => {
            let widening = Widening::Origin(*origin);
            too_far(case, extra, &|axis, ends, starts| widening.gap_limit(axis, ends, starts))
        }
    };
    let Some(&TooFar { pair, axis, gap, stated }) = far.first() else { return Ok(()) };
    let what = format!(
        "pair {pair:?} has a gap of {gap:e} on axis {axis}, and the mode states {stated:e} at most"
    );
    Err(Finding { what, missed: 0, extra: far.len() as u64, first: Some(pair) })
}

/// The extra pairs that are farther apart than stated, each with the first axis on which it is.
pub(super) fn too_far(
    case: &ModeCase,
    extra: impl Iterator<Item = Pair>,
    stated: &Stated<'_>,
) -> Vec<TooFar> {
    let faces = |index: u32| match &case.sending {
        Sending::World { boxes, .. } => boxes[index as usize],
        Sending::Narrow(_) | Sending::Inflated(_) => {
            let b = &case.given[index as usize];
            [b.min.map(f64::from), b.max.map(f64::from)]
        }
    };
    extra.filter_map(|(i, j)| far_on_an_axis((i, j), &faces(i), &faces(j), stated)).collect()
}

fn far_on_an_axis(pair: Pair, a: &Faces, b: &Faces, stated: &Stated<'_>) -> Option<TooFar> {
    (0..3).find_map(|axis| {
        let ends = a[1][axis].min(b[1][axis]);
        let starts = a[0][axis].max(b[0][axis]);
        if starts <= ends {
            return None;
        }
        let stated = stated(axis, ends, starts);
        let is_within = difference_is_at_most(starts, ends, stated);
        (!is_within).then_some(TooFar { pair, axis, gap: starts - ends, stated })
    })
}

/// Whether x − y ≤ `limit` in the arithmetic of real numbers. False where one of them is a NaN.
fn difference_is_at_most(x: f64, y: f64, limit: f64) -> bool {
    if limit == f64::INFINITY {
        return true;
    }
    let difference = x - y;
    if difference != limit || difference.is_infinite() {
        return difference < limit;
    }
    // The difference rounds to the limit: the rounding error decides (two-sum, Knuth).
    let virtual_y = x - difference;
    let virtual_x = difference + virtual_y;
    (x - virtual_x) + (virtual_y - y) <= 0.0
}

#[cfg(test)]
mod tests {
    use pairmaskd::scene::Random;

    use super::*;
    use crate::stress::Case;
    use crate::stress::modes::Usage;

    #[test]
    fn differences_are_compared_without_rounding() {
        assert!(difference_is_at_most(3.0, 1.0, 2.0) && !difference_is_at_most(3.0, 1.0, 1.9));
        // 1 + 2⁻⁶⁰ rounds to 1.
        let tiny = 2.0f64.powi(-60);
        assert!(!difference_is_at_most(1.0, -tiny, 1.0) && difference_is_at_most(1.0, tiny, 1.0));
        assert!(difference_is_at_most(f64::INFINITY, 0.0, f64::INFINITY));
        assert!(!difference_is_at_most(f64::INFINITY, 0.0, f64::MAX));
        assert!(!difference_is_at_most(f64::NAN, 0.0, 1.0));
    }

    /// The check itself: stated gaps of half the size are found in every usage.
    #[test]
    fn a_gap_that_is_stated_too_small_is_found() {
        for usage in Usage::ALL {
            let (mut measured, mut found) = (0, 0);
            let mut run = Random::new(11);
            for _ in 0..150 {
                let case = Case::new(Case::next_seed(&mut run));
                let case = case.in_mode(usage);
                // An engine's answer: the pairs of the boxes that were sent.
                let got = pairmask_core::oracle::truth(&case.sent).pairs;
                assert_eq!(check(case, &got), Ok(()), "{usage}");
                let extra = || absent(&got, &case.allowed.must.pairs);
                measured += extra().count();
                let less = |axis: usize, ends: f64, starts: f64| {
                    let limit = match &case.sending {
                        Sending::Narrow(p) => p.widening().gap_limit(axis, ends, starts),
                        Sending::Inflated(margin) => {
                            margin.gap_limit(&Widening::None, axis, ends, starts)
                        }
                        Sending::World { origin, .. } => {
                            Widening::Origin(*origin).gap_limit(axis, ends, starts)
                        }
                    };
                    0.5 * limit
                };
                found += too_far(case, extra(), &less).len();
            }
            assert!(measured > 0 && found > 0, "{usage}: {measured} measured, {found} found");
        }
    }
}
