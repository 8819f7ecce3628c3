//! The forms of `bench replies`: every one holds the pairs of the mask, in the bytes that its
//! definition says.

use std::collections::BTreeSet;

use pairmask::{BoxCount, MaskView};
use pairmask_tests::mask_writer::write_sparse;
use pairmask_tests::oracle::Pair;
use pairmask_tests::oracle::check::Mismatch;
use pairmask_tests::pair_scenes::{all_pairs, random_order, random_pairs, renamed};
use pairmaskd::study::replies::{Encoded, Form, MaskCopy, check};
use proptest::collection::vec;
use proptest::prelude::*;

/// Bytes of a form, without the order, by its definition. `positions` are pairs (row, column).
fn bytes_of(form: Form, n: BoxCount, positions: &[Pair]) -> u64 {
    let words_of = |bits: u32| {
        let words: BTreeSet<Pair> = positions.iter().map(|(p, q)| (*p, q / bits)).collect();
        words.len() as u64
    };
    let n = u64::from(n.get());
    match form {
        Form::Sparse => 12 * words_of(32),
        Form::Prefix => 4 * (n + 1) + 8 * words_of(32),
        Form::Words64 => 16 * words_of(64),
        Form::Packed if positions.iter().any(|(p, q)| q / 32 - p / 32 > 65_535) => {
            12 * words_of(32)
        }
        Form::Packed => 4 * n.div_ceil(65_536) + 8 * words_of(32),
        Form::List => 8 * positions.len() as u64,
    }
}

/// What is wrong with a form of the mask of some positions, with and without an order.
fn wrong_form(n: BoxCount, positions: &[Pair], order: Option<&[u32]>) -> Option<(Form, String)> {
    let pairs = match order {
        Some(order) => renamed(positions, order),
        None => positions.to_vec(),
    };
    let written = write_sparse(n, &pairs, order);
    let view = MaskView::new(n, &written.shape, &written.reply).expect("the writer's own shape");
    let mask = MaskCopy::of(&view).expect("the writer keeps the rules");
    let order_bytes = 4 * order.map_or(0, <[u32]>::len) as u64;
    Form::ALL.into_iter().find_map(|form| {
        let encoded = Encoded::new(form, &mask);
        let bytes = (encoded.bytes(), encoded.order_bytes());
        let order_bytes = if form.has_positions() { order_bytes } else { 0 };
        let expected = (bytes_of(form, n, positions), order_bytes);
        let wrong = match check(&encoded, &pairs) {
            Err(mismatch) => Some(mismatch.to_string()),
            Ok(()) if bytes != expected => Some(format!("{bytes:?} bytes, not {expected:?}")),
            Ok(()) => None,
        };
        wrong.map(|wrong| (form, wrong))
    })
}

/// Pairs of positions, each once, sorted.
fn distinct(pairs: impl IntoIterator<Item = Pair>) -> Vec<Pair> {
    pairs.into_iter().collect::<BTreeSet<_>>().into_iter().collect()
}

proptest! {
    #[test]
    fn every_form_holds_the_pairs_of_random_masks(
        n in prop_oneof![8 => 0u32..70, 4 => Just(345), 4 => Just(1_234), 1 => Just(70_001)],
        per_box in 0usize..12,
        // Runs of columns, which fill words, and rows with many of them.
        runs in vec((any::<u32>(), any::<u32>(), 1u32..200), 0..4),
        seed: u64,
        is_ordered: bool,
    ) {
        let count = BoxCount::new(n);
        let random = random_pairs(count, (per_box * count.len() / 4).min(10_000), seed);
        let run = |(row, first, len): (u32, u32, u32)| {
            let row = row % n.max(1);
            let first = row + 1 + first % n.max(1);
            (first..first.saturating_add(len).min(n)).map(move |column| (row, column))
        };
        // The last row and the last column that there can be.
        let last = (n >= 2).then(|| (n - 2, n - 1));
        let positions = distinct(random.into_iter().chain(runs.into_iter().flat_map(run)).chain(last));
        let order = is_ordered.then(|| random_order(count, seed));
        prop_assert_eq!(wrong_form(count, &positions, order.as_deref()), None);
    }
}

#[test]
fn full_and_empty_masks_have_every_form() {
    for n in (0..=70).chain([345]).map(BoxCount::new) {
        let order = random_order(n, 3);
        for positions in [Vec::new(), all_pairs(n)] {
            assert_eq!(wrong_form(n, &positions, None), None, "{n:?}");
            assert_eq!(wrong_form(n, &positions, Some(&order)), None, "{n:?}");
        }
    }
}

#[test]
fn a_row_may_have_more_words_than_a_batch() {
    let n = BoxCount::new(20_000);
    let rows = [0, 1, 2, 9_000].into_iter();
    let positions = distinct(
        rows.flat_map(|row| (row + 1..n.get()).step_by(31).map(move |column| (row, column))),
    );
    assert_eq!(wrong_form(n, &positions, None), None);
}

#[test]
fn packed_addresses_reach_65535_blocks_and_groups_of_65536_rows() {
    let n = BoxCount::new((1 << 21) + 1_000);
    let at = |row: u32, blocks: u32, bit: u32| (row, 32 * (row / 32 + blocks) + bit);
    let near = [
        at(0, 65_535, 0),
        at(31, 65_535, 31),
        at(65_535, 1, 5),
        at(65_536, 0, 31),
        at(131_072, 2, 0),
        (n.get() - 2, n.get() - 1),
    ];
    assert_eq!(wrong_form(n, &distinct(near), None), None);
    let far = [at(0, 65_536, 0), at(40, 65_536, 7)];
    for one in far {
        assert_eq!(wrong_form(n, &distinct(near.into_iter().chain([one])), None), None);
        assert_eq!(wrong_form(n, &[one], None), None);
    }
}

#[test]
fn a_form_of_another_mask_is_noticed() {
    let n = BoxCount::new(345);
    let pairs = random_pairs(n, 500, 9);
    let written = write_sparse(n, &pairs, None);
    let view = MaskView::new(n, &written.shape, &written.reply).expect("the writer's own shape");
    let mask = MaskCopy::of(&view).expect("the writer keeps the rules");
    for form in Form::ALL {
        let encoded = Encoded::new(form, &mask);
        assert_eq!(check(&encoded, &pairs), Ok(()), "{form:?}");
        let rest = &pairs[1..];
        assert_eq!(check(&encoded, rest), Err(Mismatch::Extra(pairs[0])), "{form:?}");
        let mut more = pairs.clone();
        more.push((343, 344));
        assert_eq!(check(&encoded, &more), Err(Mismatch::Missing((343, 344))), "{form:?}");
    }
}
