//! Errors of the variants: ids mapped to another pair or to none, pairs missed, pairs tested more
//! than once, the distance of wrong rows; and wrong integer parts of roots.

use std::sync::atomic::{AtomicU64, Ordering};

use pairmask_core::pair_index::row_start;
use pairmask_core::{BoxCount, PairIndex};
use pairmaskd::scene::Random;
use rayon::prelude::*;
use serde::Serialize;

use super::stage::{Root, Variant};
use super::variants::{Mapped, map, named, next_pair, truth, with_root};
use crate::study::harness::{Fields, row};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    pub ids: u64,
    pub skipped: u64,
    pub wrong: u64,
    pub wrong_named: u64,
    pub largest_row_error: u64,
    pub first_wrong: Option<u64>,
}

impl Tally {
    pub fn wrong_share(&self) -> f64 {
        self.wrong as f64 / (self.ids - self.skipped).max(1) as f64
    }

    fn note(&mut self, k: u64, n: BoxCount, mapped: Mapped, expected: [u32; 2]) {
        if mapped != expected.map(i64::from) {
            self.wrong += 1;
            self.wrong_named += u64::from(named(mapped, n).is_some());
            let off = mapped[0].abs_diff(i64::from(expected[0]));
            self.largest_row_error = self.largest_row_error.max(off);
            self.first_wrong = Some(self.first_wrong.map_or(k, |first| first.min(k)));
        }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            ids: self.ids + other.ids,
            skipped: self.skipped + other.skipped,
            wrong: self.wrong + other.wrong,
            wrong_named: self.wrong_named + other.wrong_named,
            largest_row_error: self.largest_row_error.max(other.largest_row_error),
            first_wrong: [self.first_wrong, other.first_wrong].into_iter().flatten().min(),
        }
    }
}

/// Coverage of the pairs when every id is used once, as shares of all pairs: counted.
pub fn counted(tally: &Tally, pairs: u64, distinct: u64) -> Fields {
    let tests = tally.ids - tally.skipped - (tally.wrong - tally.wrong_named);
    row!(
        kind: "counted",
        missed: (pairs - distinct) as f64 / pairs as f64,
        // Tests of a pair that was tested before.
        repeated: tests.saturating_sub(distinct) as f64 / pairs as f64,
    )
}

/// Bounds of the coverage from the checked ids. A pair can be missed only if its own id is wrong, and is missed
/// then unless another wrong id happens to name it.
pub fn bounded(tally: &Tally) -> Fields {
    let tested = (tally.ids - tally.skipped).max(1) as f64;
    row!(
        kind: "bounded",
        missed_least: (tally.wrong - tally.wrong_named) as f64 / tested,
        missed_most: tally.wrong as f64 / tested,
        repeated_most: tally.wrong_named as f64 / tested,
    )
}

/// Step of the streams of [`Random`].
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

const CHUNK: u64 = 1 << 15;

/// Checks `count` ids, chunk by chunk: `id` gives them, `map` answers, `see` is called with each right id's answer.
fn tally_of(
    variant: Variant,
    n: BoxCount,
    count: u64,
    id: impl Fn(u64) -> u64 + Sync,
    map: impl Fn(u64) -> Mapped + Sync,
    see: impl Fn(Mapped) + Sync,
) -> Tally {
    let chunk = |chunk: u64| {
        let mut tally = Tally::default();
        // The id that was last, and its pair: the next id's is found by a step.
        let mut last: Option<(u64, [u32; 2])> = None;
        let in_row_order = !matches!(variant, Variant::Fold | Variant::Lazy);
        for i in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
            let k = id(i);
            tally.ids += 1;
            let expected = match last {
                Some((before, pair)) if in_row_order && before + 1 == k => Some(next_pair(n, pair)),
                _ => truth(variant, n, k),
            };
            match expected {
                Some(pair) => {
                    let mapped = map(k);
                    tally.note(k, n, mapped, pair);
                    see(mapped);
                }
                None => tally.skipped += 1,
            }
            last = expected.map(|pair| (k, pair));
        }
        tally
    };
    (0..count.div_ceil(CHUNK)).into_par_iter().map(chunk).reduce(Tally::default, Tally::plus)
}

/// Checks every id of a variant, and counts the coverage of the pairs.
pub fn exhaustive(variant: Variant, n: BoxCount) -> (Tally, Fields) {
    exhaustive_by(variant, n, |k| map(variant, n, k))
}

fn exhaustive_by(
    variant: Variant,
    n: BoxCount,
    map: impl Fn(u64) -> Mapped + Sync,
) -> (Tally, Fields) {
    let (pairs, total) = (n.pair_count(), variant.id_count(n.get()));
    let tally = tally_of(variant, n, total, |k| k, &map, |_| ());
    if tally.wrong == 0 {
        // Each id names its own pair.
        return (tally, row!(kind: "counted", missed: 0.0, repeated: 0.0));
    }
    // A bit for each pair, in row order; set when it is named.
    let bits: Vec<AtomicU64> = (0..pairs.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
    let mark = |mapped: Mapped| {
        if let Some([a, b]) = named(mapped, n) {
            let index = row_start(n, a) + u64::from(b - a - 1);
            bits[(index / 64) as usize].fetch_or(1 << (index % 64), Ordering::Relaxed);
        }
    };
    tally_of(variant, n, total, |k| k, &map, mark);
    let ones = |word: AtomicU64| u64::from(word.into_inner().count_ones());
    let distinct = bits.into_par_iter().map(ones).sum();
    (tally, counted(&tally, pairs, distinct))
}

/// Checks `count` ids chosen evenly at random, the same ones in each run.
pub fn sampled(variant: Variant, n: BoxCount, count: u64) -> Tally {
    let total = variant.id_count(n.get());
    // The top bits of a product spread a 64-bit random number over the ids without bias.
    let id = |i: u64| {
        ((u128::from(Random::new(i.wrapping_mul(GOLDEN)).bits()) * u128::from(total)) >> 64) as u64
    };
    tally_of(variant, n, if total == 0 { 0 } else { count }, id, |k| map(variant, n, k), |_| ())
}

/// Checks the first and the last id of every row, where wrong rounding of a root shows first.
pub fn around_rows(variant: Variant, n: BoxCount) -> Tally {
    let rows = u64::from(n.get().saturating_sub(1));
    let id = |i: u64| {
        let row = (i / 2) as u32;
        let k = if i.is_multiple_of(2) { row_start(n, row) } else { row_start(n, row + 1) - 1 };
        own_id(variant, n, k)
    };
    tally_of(variant, n, 2 * rows, id, |k| map(variant, n, k), |_| ())
}

fn own_id(variant: Variant, n: BoxCount, k: u64) -> u64 {
    match (variant, PairIndex::new(k).pair(n)) {
        (Variant::Lazy, Some([a, b])) => u64::from(a) * u64::from(n.get()) + u64::from(b),
        // The fold's rows end at other ids. Any ids are good for it, and these are evenly spread.
        _ => k,
    }
}

/// Fewest boxes, up to `limit`, for which some row starts or ends wrongly.
pub fn first_wrong_count(variant: Variant, limit: u32) -> Option<u32> {
    (2..=limit).into_par_iter().find_first(|n| {
        let n = BoxCount::new(*n);
        let wrong =
            |k: u64, pair: [u32; 2]| map(variant, n, own_id(variant, n, k)) != pair.map(i64::from);
        (0..n.get() - 1).rev().any(|a| {
            let (first, end) = (row_start(n, a), row_start(n, a + 1));
            wrong(first, [a, a + 1]) || wrong(end - 1, [a, n.get() - 1])
        })
    })
}

/// Wrong integer parts among the roots of 1 to `count` (Avril et al. 2012, table 3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RootTally {
    pub count: u64,
    pub other: u64,
    pub inexact: u64,
}

pub fn count_roots(root: Root, count: u64) -> RootTally {
    with_root!(root, root => count_roots_by(root, count))
}

fn count_roots_by(root: impl Fn(f32) -> f32 + Sync, count: u64) -> RootTally {
    let chunk = |chunk: u64| {
        let (mut other, mut inexact) = (0, 0);
        for x in chunk * CHUNK + 1..=count.min((chunk + 1) * CHUNK) {
            let part = root(x as f32) as u64;
            other += u64::from(part != (x as f32).sqrt() as u64);
            inexact += u64::from(part * part > x || (part + 1) * (part + 1) <= x);
        }
        (other, inexact)
    };
    let chunks = (0..count.div_ceil(CHUNK)).into_par_iter().map(chunk);
    let (other, inexact) = chunks.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    RootTally { count, other, inexact }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::mapping::stage::{Magic, PAPERS_OWN};
    use crate::study::mapping::variants::row_search;

    const fn closed(root: Root, corrected: bool) -> Variant {
        Variant::Closed { root, integer: false, corrected }
    }

    fn coverage(missed: f64, repeated: f64) -> Fields {
        row!(kind: "counted", missed, repeated)
    }

    const fn boxes(n: u32) -> BoxCount {
        BoxCount::new(n)
    }

    #[test]
    fn the_closed_form_is_exact_to_4097_boxes_and_not_beyond() {
        assert_eq!(first_wrong_count(PAPERS_OWN, 4097), None);
        assert_eq!(exhaustive(PAPERS_OWN, boxes(4096)).0.wrong, 0);
        for (n, first_wrong) in [(4098, 4096), (4113, 4111)] {
            let (tally, found) = exhaustive(PAPERS_OWN, boxes(n));
            assert_eq!((tally.first_wrong, tally.largest_row_error), (Some(first_wrong), 1));
            assert_ne!(found, coverage(0.0, 0.0));
        }
    }

    #[test]
    fn newtons_steps_have_known_shares_of_wrong_pairs_and_a_sample_is_near_the_whole() {
        for (steps, wrong) in [(1, 0.80), (2, 0.0031), (3, 0.000_07)] {
            let variant = closed(Root::Newton(Magic::Carmack, steps), false);
            let share = exhaustive(variant, boxes(3000)).0.wrong_share();
            assert!((share / wrong - 1.0).abs() < 0.05, "{variant}: {share}");
            let part = sampled(variant, boxes(3000), 100_000).wrong_share();
            assert!((share - part).abs() < 0.01, "{share} and {part}");
        }
    }

    #[test]
    fn one_row_too_many_is_corrected_and_two_are_not() {
        let corrected = closed(Root::BuiltIn, true);
        assert_eq!(exhaustive(corrected, boxes(8192)), {
            let ids = boxes(8192).pair_count();
            (Tally { ids, ..Tally::default() }, coverage(0.0, 0.0))
        });
        let tally = around_rows(corrected, boxes(16_384));
        assert_eq!((tally.wrong > 0, tally.largest_row_error), (true, 2));
        // From here on the last ids are past 2^24 and f32 does not hold them.
        assert!((2..5_794).rev().step_by(97).all(|n| around_rows(corrected, boxes(n)).wrong == 0));
        assert_eq!(around_rows(corrected, boxes(5_793)).wrong, 0);
        assert!(around_rows(corrected, boxes(5_794)).wrong > 0);
        let integer = Variant::Closed { root: Root::BuiltIn, integer: true, corrected: true };
        assert_eq!(around_rows(integer, boxes(100_000)).wrong, 0);
    }

    #[test]
    fn exact_variants_have_nothing_wrong_at_any_size() {
        for variant in
            [Variant::FarEnd, Variant::RowSearch, Variant::Fold, Variant::WordStep, Variant::Lazy]
        {
            for n in (0..70).chain([345, 1234]).map(BoxCount::new) {
                let (tally, found) = exhaustive(variant, n);
                assert_eq!((tally.wrong, found), (0, coverage(0.0, 0.0)), "{variant}, {n:?}");
                assert_eq!(tally.ids - tally.skipped, n.pair_count(), "{variant}, {n:?}");
            }
            let large = boxes(1_000_000);
            assert_eq!(around_rows(variant, large).wrong, 0, "{variant}");
            assert_eq!(sampled(variant, large, 10_000).wrong, 0, "{variant}");
        }
    }

    /// Coverage against a count by hand, with two neighbours replaced by one wrong pair.
    #[test]
    fn a_repeated_pair_is_a_missed_pair_and_both_are_counted() {
        let n = boxes(10);
        let broken = |k| row_search(n, if k == 7 { 6 } else { k });
        let (tally, found) = exhaustive_by(Variant::RowSearch, n, broken);
        assert_eq!((tally.wrong, tally.wrong_named, tally.first_wrong), (1, 1, Some(7)));
        let one = 1.0 / 45.0;
        assert_eq!(found, coverage(one, one));
    }

    /// Known figures, so that a change of arithmetic is noticed.
    #[test]
    fn shares_of_wrong_roots_are_near_those_of_the_paper() {
        for (magic, steps, numbers, other) in [
            (Magic::Carmack, 2, 1000, 30),
            (Magic::Lomont, 2, 1000, 29),
            (Magic::Carmack, 2, 100_000, 279),
            (Magic::Carmack, 2, 1_000_000, 1813),
            (Magic::Lomont, 2, 1_000_000, 1819),
            (Magic::Carmack, 3, 100_000, 70),
            (Magic::Carmack, 4, 100_000, 84),
        ] {
            let tally = count_roots(Root::Newton(magic, steps), numbers);
            assert_eq!((tally.other, tally.inexact), (other, other), "{magic:?} {steps:?}");
        }
        assert_eq!(count_roots(Root::BuiltIn, 1_000_000).inexact, 0);
        assert_eq!(count_roots_by(|x| x.sqrt() + 1.0, 100).inexact, 100, "it is noticed");
    }
}
