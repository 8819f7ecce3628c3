//! Tests of the inverse against counting and against u128 arithmetic, with a comparator that is
//! shown to fail.

use proptest::prelude::*;
use rayon::prelude::*;

use super::{PairWalker, row_start};
use crate::units::{BoxCount, PairIndex};

type Pair = [u32; 2];

/// A place where an inverse disagrees with the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Mismatch {
    n: u32,
    k: u64,
    expected: Option<Pair>,
    found: Option<Pair>,
}

/// Counts through the pairs of `n` boxes and compares each with `inverse`, and the index past the
/// last pair with `None`.
fn first_mismatch(n: u32, inverse: impl Fn(BoxCount, u64) -> Option<Pair>) -> Option<Mismatch> {
    let count = BoxCount::new(n);
    let check = |k, expected| {
        let found = inverse(count, k);
        (found != expected).then_some(Mismatch { n, k, expected, found })
    };
    let mut k = 0;
    for a in 0..n {
        for b in a + 1..n {
            if let Some(mismatch) = check(k, Some([a, b])) {
                return Some(mismatch);
            }
            k += 1;
        }
    }
    check(k, None)
}

fn production(n: BoxCount, k: u64) -> Option<Pair> {
    PairIndex::new(k).pair(n)
}

/// S(a) + b − a − 1 in u128, as it stands in the module's head.
fn index_u128(n: u32, [a, b]: Pair) -> u128 {
    let (n, a, b) = (u128::from(n), u128::from(a), u128::from(b));
    a * (2 * n - a - 1) / 2 + b - a - 1
}

/// Counts of boxes that all pairs of are counted. Miri takes a thousand times as long.
const COUNTED: u32 = if cfg!(miri) { 40 } else { 2_000 };

#[test]
fn inverse_equals_counting_for_every_small_n() {
    let mismatch = (0..=COUNTED).into_par_iter().find_map_any(|n| first_mismatch(n, production));
    assert_eq!(mismatch, None);
}

#[test]
fn comparator_finds_one_wrong_pair() {
    let swapped = |n: BoxCount, k: u64| match k {
        1_000 => Some([3, 2]),
        _ => production(n, k),
    };
    let found = first_mismatch(345, swapped);
    let expected = production(BoxCount::new(345), 1_000);
    assert_eq!(found, Some(Mismatch { n: 345, k: 1_000, expected, found: Some([3, 2]) }));

    let never_ends = |n: BoxCount, k: u64| production(n, k.min(n.pair_count() - 1));
    assert_eq!(first_mismatch(70, never_ends).map(|m| m.k), Some(70 * 69 / 2));
}

/// Both ends of row `a` and their neighbours.
fn check_row_ends(n: u32, a: u32) {
    let count = BoxCount::new(n);
    let first = row_start(count, a);
    assert_eq!(u128::from(first), index_u128(n, [a, a + 1]), "n {n} row {a}");
    let last = first + u64::from(n - 2 - a);
    assert_eq!(production(count, first), Some([a, a + 1]), "n {n} row {a}");
    assert_eq!(production(count, last), Some([a, n - 1]), "n {n} row {a}");
    if a > 0 {
        assert_eq!(production(count, first - 1), Some([a - 1, n - 1]), "n {n} row {a}");
    }
    let next = (a + 2 < n).then_some([a + 1, a + 2]);
    assert_eq!(production(count, last + 1), next, "n {n} row {a}");
    if a + 2 < n {
        assert_eq!(production(count, first + 1), Some([a, a + 2]), "n {n} row {a}");
        assert_eq!(production(count, last - 1), Some([a, n - 2]), "n {n} row {a}");
    }
}

#[test]
fn every_row_end_is_exact_for_n_to_100000() {
    let near_powers = (1..=16).flat_map(|e| [(1 << e) - 1, 1 << e, (1 << e) + 1]);
    let strided = (0..=100_000).step_by(3_331);
    // f32 fails soon after 4096; n² leaves u32 at 65,536 and k at 92,682.
    let named = [0, 1, 345, 1_234, 4_112, 4_113, 16_384, 32_768, 92_681, 92_682, 92_683];
    let last = 99_990..=100_000;
    let all: Vec<u32> = near_powers.chain(strided).chain(named).chain(last).collect();
    let stride = if cfg!(miri) { 9_973 } else { 1 };
    all.into_par_iter().for_each(|n| {
        (0..n.saturating_sub(1)).step_by(stride).for_each(|a| check_row_ends(n, a));
    });
}

#[test]
fn rows_at_both_ends_are_exact_for_the_largest_counts() {
    let counts = (20..32).flat_map(|e| [(1u32 << e) - 1, 1 << e, (1 << e) + 1]);
    for n in counts.chain([u32::MAX - 2, u32::MAX - 1, u32::MAX]) {
        let rows = n - 1;
        let spread = (0..1_000).map(|i| (u64::from(rows - 1) * i / 999) as u32);
        let stride = if cfg!(miri) { 97 } else { 1 };
        for a in (0..300).chain(rows - 300..rows).chain(spread).step_by(stride) {
            check_row_ends(n, a);
        }
    }
}

#[test]
fn counts_without_a_pair_have_no_index() {
    for n in [0, 1].map(BoxCount::new) {
        assert_eq!(production(n, 0), None);
        assert_eq!(PairIndex::of(n, 0, 1), None);
        assert_eq!((row_start(n, 0), row_start(n, u32::MAX)), (0, 0));
    }
    assert_eq!(production(BoxCount::new(u32::MAX), u64::MAX), None);
}

#[test]
fn walker_follows_counting_with_every_stride() {
    let largest = if cfg!(miri) { 9 } else { 70 };
    for n in (0..=20).chain([70]).filter(|n| *n <= largest) {
        let count = BoxCount::new(n);
        let pairs: Vec<Pair> = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b])).collect();
        for from in 0..=pairs.len() {
            let start = PairWalker::start(count, PairIndex::new(from as u64));
            assert_eq!(start.map(|w| w.pair()), pairs.get(from).copied(), "n {n} from {from}");
            for distance in 0..=100 {
                let found = start.and_then(|w| w.advance(distance)).map(|w| w.pair());
                let expected = pairs.get(from + distance as usize).copied();
                assert_eq!(found, expected, "n {n} from {from} + {distance}");
            }
        }
    }
}

fn count_and_pair() -> impl Strategy<Value = (u32, Pair)> {
    (2u32.., any::<u32>(), any::<u32>()).prop_map(|(n, x, y)| {
        let a = x % (n - 1);
        (n, [a, a + 1 + y % (n - 1 - a)])
    })
}

proptest! {
    #[test]
    fn index_and_pair_are_inverse((n, pair) in count_and_pair()) {
        let count = BoxCount::new(n);
        let k = PairIndex::of(count, pair[0], pair[1]).map(PairIndex::get);
        prop_assert_eq!(k.map(u128::from), Some(index_u128(n, pair)));
        prop_assert_eq!(production(count, k.unwrap_or(u64::MAX)), Some(pair));
    }

    #[test]
    fn pair_of_any_index_is_in_range_and_maps_back(n: u32, k: u64) {
        let count = BoxCount::new(n);
        for k in [k, k % count.pair_count().max(1)] {
            match production(count, k) {
                Some([a, b]) => {
                    prop_assert_eq!(PairIndex::of(count, a, b), Some(PairIndex::new(k)));
                }
                None => prop_assert!(k >= count.pair_count()),
            }
        }
    }

    #[test]
    fn no_index_unless_a_before_b_before_n(n: u32, a: u32, b: u32) {
        prop_assert_eq!(PairIndex::of(BoxCount::new(n), a, b).is_some(), a < b && b < n);
    }

    #[test]
    fn walker_equals_inverse_for_large_counts((n, pair) in count_and_pair(), by in 0u32..4_096) {
        let count = BoxCount::new(n);
        let k = index_u128(n, pair) as u64;
        let walked = PairWalker::start(count, PairIndex::new(k)).and_then(|w| w.advance(by));
        prop_assert_eq!(walked.map(|w| w.pair()), production(count, k + u64::from(by)));
    }
}
