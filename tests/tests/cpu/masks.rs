//! Masks: every decoder gives the pairs that were written, and decoding any bytes is safe.

use std::collections::BTreeSet;

use pairmask_core::engine::AvailableIsa;
use pairmask_core::mask::{MaskError, Section, Span, WordAddress};
use pairmask_tests::mask_writer::{
    WrittenMask, all_pairs, random_order, random_pairs, renamed, write_dense, write_list,
    write_sparse,
};
use pairmask_tests::prelude::*;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use rayon::iter::ParallelIterator;

/// The pairs in all encodings: sparse with and without an order, and listed in no order.
fn all_encodings(n: BoxCount, pairs: &[Pair]) -> [WrittenMask; 4] {
    let order = random_order(n, 7);
    let slots = random_order(BoxCount::new(pairs.len() as u32), 8);
    let shuffled: Vec<Pair> = slots.iter().map(|slot| pairs[*slot as usize]).collect();
    [
        write_dense(n, pairs),
        write_sparse(n, pairs, None),
        write_sparse(n, pairs, Some(&order)),
        write_list(n, &shuffled),
    ]
}

fn view(mask: &WrittenMask) -> MaskView<'_> {
    MaskView::new(mask.n, &mask.shape, &mask.reply).expect("the writer's own shape")
}

/// The mask, once for every instruction set of this machine.
fn each_isa(view: MaskView<'_>) -> impl Iterator<Item = MaskView<'_>> {
    Isa::ALL.into_iter().filter_map(AvailableIsa::new).map(move |isa| view.with_isa(isa))
}

/// Compares all ways to decode a mask with `expected`; returns the first that differs.
fn first_wrong_way(mask: &WrittenMask, expected: &[Pair]) -> Option<&'static str> {
    each_isa(view(mask)).find_map(|view| wrong_way(view, expected))
}

fn wrong_way(view: MaskView<'_>, expected: &[Pair]) -> Option<&'static str> {
    let sorted = |mut pairs: Vec<Pair>| {
        pairs.sort_unstable();
        pairs
    };
    let listed = view.to_vec();
    let mut each = Vec::new();
    view.for_each(|a, b| each.push([a, b]));
    let mut halves: Vec<Pair> = view.pairs().take(listed.len() / 2).collect();
    halves.extend(view.pairs().skip(listed.len() / 2));
    let mut slices = Vec::new();
    let mut no_slice_is_empty = true;
    view.for_each_slice(|pairs| {
        no_slice_is_empty &= !pairs.is_empty();
        slices.extend_from_slice(pairs);
    });
    let word_bits: u32 = view.words().map(|word| word.bits.count()).sum();
    let found: BTreeSet<Pair> = listed.iter().copied().collect();
    let probe = |a: u32, b: u32| {
        view.contains(a, b) == found.contains(&[a.min(b), a.max(b)])
            && (a != b || !view.contains(a, b))
    };
    let near = |i: u32| [i, i.wrapping_add(1), view.n().get().wrapping_sub(i), i / 2, u32::MAX - i];
    // A list is searched from its start for each: of many pairs some thousands.
    let mut some = expected.iter().step_by(1 + expected.len() / 4_000);
    let checks = [
        ("to_vec", sorted(listed.clone()) == expected),
        ("for_each", each == listed),
        ("pairs in halves", halves == listed),
        ("for_each_slice", no_slice_is_empty && slices == listed),
        ("par_pairs", view.par_pairs().collect::<Vec<_>>() == listed),
        ("count", view.count() == expected.len() as u64),
        ("is_empty", view.is_empty() == expected.is_empty()),
        ("words", word_bits as usize == expected.len()),
        ("contains its pairs", some.all(|&[a, b]| view.contains(a, b) && view.contains(b, a))),
        ("contains no other", (0..40).all(|a| near(a).into_iter().all(|b| probe(a, b)))),
        ("verify", view.verify() == Ok(())),
    ];
    checks.into_iter().find(|(_, right)| !right).map(|(way, _)| way)
}

#[test]
fn every_way_through_a_mask_gives_its_pairs() {
    for n in (0..=70).chain([345, 1_234, 4_321]).map(BoxCount::new) {
        let few = random_pairs(n, n.len(), 3);
        let many = random_pairs(n, 45 * n.len(), 4);
        // The last sizes have several tasks.
        let every = if n.get() < 1_000 { all_pairs(n) } else { Vec::new() };
        for pairs in [Vec::new(), few, many, every] {
            for mask in all_encodings(n, &pairs) {
                let naive = naive_decoder::decode(&mask.reply, &mask.shape, n.get());
                assert_eq!(naive, Ok(pairs.clone()));
                assert_eq!(first_wrong_way(&mask, &pairs), None, "{n:?} {:?}", mask.shape);
            }
        }
    }
}

#[test]
fn the_comparison_notices_each_flipped_bit() {
    let n = BoxCount::new(70);
    let pairs = random_pairs(n, 100, 6);
    for mask in all_encodings(n, &pairs) {
        let bits = match mask.shape {
            MaskShape::Dense { words } => words,
            MaskShape::Sparse { bits, .. } => bits,
            MaskShape::List { pairs } => pairs,
            shape => panic!("which words of {shape:?} are bits of pairs?"),
        };
        for word in bits.start..bits.start + bits.len {
            let mut flipped = mask.clone();
            flipped.reply[word as usize] ^= 1 << (word % 32);
            assert!(first_wrong_way(&flipped, &pairs).is_some(), "word {word} of {:?}", mask.shape);
        }
    }
}

#[test]
fn pairs_come_in_the_order_of_the_index_or_the_words() {
    let n = BoxCount::new(345);
    let pairs = random_pairs(n, 1_000, 8);
    assert_eq!(view(&write_dense(n, &pairs)).to_vec(), pairs);
    assert_eq!(view(&write_sparse(n, &pairs, None)).to_vec(), pairs);
    let order = random_order(n, 9);
    let ordered = write_sparse(n, &renamed(&pairs, &order), Some(&order));
    let named: Vec<Pair> = pairs
        .iter()
        .map(|&[p, q]| [order[p as usize], order[q as usize]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    assert_eq!(view(&ordered).to_vec(), named);
    assert_eq!(view(&write_list(n, &named)).to_vec(), named);
}

#[test]
fn words_come_with_their_addresses() {
    let n = BoxCount::new(70);
    let pairs = [[0, 1], [0, 40], [1, 69]];
    let sparse = write_sparse(n, &pairs, None);
    let addresses: Vec<_> = view(&sparse).words().map(|word| (word.address, word.bits.0)).collect();
    let at = |row, block| WordAddress::Sparse { row, block };
    assert_eq!(addresses, [(at(0, 0), 1 << 1), (at(0, 1), 1 << 8), (at(1, 2), 1 << 5)]);
    let dense = write_dense(n, &pairs);
    let list = write_list(n, &[[1, 69], [0, 40]]);
    let addresses: Vec<_> = view(&list).words().map(|word| (word.address, word.bits.0)).collect();
    assert_eq!(addresses, [(at(1, 2), 1 << 5), (at(0, 1), 1 << 8)]);
    let firsts: Vec<_> = view(&dense)
        .words()
        .map(|word| match word.address {
            WordAddress::Dense { first } => (first.get(), word.bits.0),
            WordAddress::Sparse { .. } => unreachable!("a dense mask has dense addresses"),
        })
        .collect();
    assert_eq!(firsts, [(0, 1), (32, 1 << 7), (128, 1 << 8)]);
}

#[test]
fn shapes_that_do_not_fit_are_refused() {
    let span = |start, len| Span { start, len };
    let dense = |start, len| MaskShape::Dense { words: span(start, len) };
    let sparse = |len, order| MaskShape::Sparse {
        rows: span(0, 3),
        blocks: span(16, 3),
        bits: span(32, len),
        order,
    };
    let order = |len| Some(span(48, len));
    let list = |start, len| MaskShape::List { pairs: span(start, len) };
    let outside =
        |section, span, reply_words| Some(MaskError::OutsideReply { section, span, reply_words });
    let (max, n) = (u64::MAX, BoxCount::new(40));
    let cases = [
        (dense(0, 25), 25, None),
        (dense(0, 24), 25, Some(MaskError::DenseLength { n: 40, expected: 25, found: 24 })),
        (dense(1, 25), 25, outside(Section::Words, span(1, 25), 25)),
        (dense(max, 25), 25, outside(Section::Words, span(max, 25), 25)),
        (sparse(3, None), 35, None),
        (sparse(3, None), 34, outside(Section::Bits, span(32, 3), 34)),
        (sparse(2, None), 35, Some(MaskError::SectionLengths { rows: 3, blocks: 3, bits: 2 })),
        (sparse(3, order(40)), 88, None),
        (sparse(3, order(39)), 88, Some(MaskError::OrderLength { n: 40, found: 39 })),
        (sparse(3, order(40)), 87, outside(Section::Order, span(48, 40), 87)),
        (list(1, 6), 7, None),
        (list(1, 5), 7, Some(MaskError::HalfPair { words: 5 })),
        (list(1, 6), 6, outside(Section::Pairs, span(1, 6), 6)),
        (list(max, max), 7, outside(Section::Pairs, span(max, max), 7)),
    ];
    for (shape, words, expected) in cases {
        assert_eq!(MaskView::new(n, &shape, &vec![0; words]).err(), expected, "{shape:?}");
    }
}

#[test]
fn verify_names_each_broken_rule() {
    let n = BoxCount::new(40);
    let pairs = [[0, 1], [0, 33], [3, 4]];
    let order: Vec<u32> = (0..40).collect();
    // Rows from word 0, blocks from 16, bits from 32, order from 48.
    let sparse = write_sparse(n, &pairs, Some(&order));
    // 780 pairs leave 20 bits of word 24 behind the last one.
    let dense = write_dense(n, &pairs);
    let list = write_list(n, &[[3, 4], [0, 33], [0, 1]]);
    let no_pair = |word, row, bits| Err(MaskError::NoSuchPair { word, row, bits });
    let not_a_pair = |number, a, b| Err(MaskError::NotAPair { number, a, b, n: 40 });
    let cases = [
        (&sparse, 33, 0, Err(MaskError::ZeroWord { word: 1 })),
        (&sparse, 17, 0, Err(MaskError::NotSorted { word: 1 })),
        (&sparse, 18, 2, Err(MaskError::NoSuchBlock { word: 2, block: 2, blocks: 2 })),
        (&sparse, 34, 0b1_1000, no_pair(2, 3, 0b1000)),
        (&sparse, 33, 0b1_0000_0010, no_pair(1, 0, 0b1_0000_0000)),
        (&sparse, 50, 1, Err(MaskError::BoxAgain { position: 2, index: 1 })),
        (&sparse, 50, 40, Err(MaskError::NoSuchBox { position: 2, index: 40, n: 40 })),
        (&dense, 24, 0xfff, Ok(())),
        (&dense, 24, 0x1fff, Err(MaskError::TailBits { bits: 0x1000 })),
        (&list, 0, 2, Ok(())),
        (&list, 0, 4, not_a_pair(0, 4, 4)),
        (&list, 3, 40, not_a_pair(1, 0, 40)),
        (&list, 4, 2, not_a_pair(2, 2, 1)),
        (&list, 5, 33, Err(MaskError::PairAgain { a: 0, b: 33 })),
    ];
    for (written, at, value, expected) in cases {
        let mut mask = written.clone();
        mask.reply[at] = value;
        assert_eq!(view(&mask).verify(), expected, "word {at} is {value}");
        let naive = naive_decoder::decode(&mask.reply, &mask.shape, 40);
        assert_eq!(naive.is_err(), expected.is_err(), "word {at} is {value}: {naive:?}");
    }
}

/// A span that mostly fits a reply of some hundred words, and is sometimes arbitrary.
fn span(len: impl Strategy<Value = u64> + 'static) -> impl Strategy<Value = Span> {
    let start = prop_oneof![9 => 0u64..64, 1 => any::<u64>()];
    let len = prop_oneof![15 => len.boxed(), 1 => any::<u64>().boxed()];
    (start, len).prop_map(|(start, len)| Span { start, len })
}

/// Arbitrary shapes, most of which can be decoded.
fn shape(n: u32) -> impl Strategy<Value = MaskShape> {
    let dense = span(Just(BoxCount::new(n).dense_words()));
    let sparse = (0u64..150).prop_flat_map(move |len| {
        let sections = [span(Just(len)), span(Just(len)), span(Just(len))];
        (sections, option::of(span(Just(u64::from(n)))))
    });
    prop_oneof![
        1 => dense.prop_map(|words| MaskShape::Dense { words }),
        2 => sparse.prop_map(|([rows, blocks, bits], order)| {
            MaskShape::Sparse { rows, blocks, bits, order }
        }),
        2 => span((0u64..150).prop_map(|pairs| 2 * pairs)).prop_map(|pairs| MaskShape::List { pairs }),
    ]
}

/// Words of a reply: small numbers that are valid rows and blocks, single bits, and arbitrary
/// words.
fn reply() -> impl Strategy<Value = Vec<u32>> {
    let word = prop_oneof![
        4 => 0u32..70,
        2 => (0u32..32).prop_map(|t| 1 << t),
        1 => any::<u32>(),
        1 => Just(u32::MAX),
    ];
    vec(word, 0..400)
}

fn any_mask() -> impl Strategy<Value = (u32, MaskShape, Vec<u32>)> {
    let n = prop_oneof![8 => 0u32..80, 1 => Just(345), 1 => any::<u32>()];
    n.prop_flat_map(|n| (Just(n), shape(n), reply()))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn no_bytes_do_harm((n, shape, reply) in any_mask(), probes in vec((0u32..90, 0u32..90), 20)) {
        let (extent, bytes) = (shape.extent_words(), shape.mask_bytes());
        let Ok(mask) = MaskView::new(BoxCount::new(n), &shape, &reply) else { return Ok(()) };
        prop_assert!(extent <= reply.len() as u64 && bytes <= 16 * reply.len() as u64);
        let pairs: Vec<Pair> = mask.pairs().collect();
        for &[a, b] in &pairs {
            prop_assert!(a < b && b < n, "({}, {}) of {}", a, b, n);
        }
        for mask in each_isa(mask) {
            prop_assert_eq!(&mask.pairs().collect::<Vec<_>>(), &pairs);
            prop_assert_eq!(&mask.to_vec(), &pairs);
        }
        prop_assert_eq!(&mask.par_pairs().collect::<Vec<_>>(), &pairs);
        let mut slices = Vec::new();
        mask.for_each_slice(|some| slices.extend_from_slice(some));
        prop_assert_eq!(&slices, &pairs);
        if let MaskView::List(list) = mask {
            let mut slices = Vec::new();
            list.for_each_slice_in_place(|some| slices.extend_from_slice(some));
            prop_assert_eq!(&slices, &pairs);
        }
        prop_assert_eq!(mask.is_empty(), pairs.is_empty());
        let bits: u64 = mask.words().map(|word| u64::from(word.bits.count())).sum();
        prop_assert_eq!(mask.count(), bits);
        let ordered = matches!(shape, MaskShape::Sparse { order: Some(_), .. });
        let spare = bits.checked_sub(pairs.len() as u64);
        prop_assert!(spare == Some(0) || (ordered && spare.is_some()));
        let found: BTreeSet<Pair> = pairs.iter().copied().collect();
        let clean = mask.verify();
        for (a, b) in probes.into_iter().chain([(n, 0), (u32::MAX, n), (n, n)]) {
            let held = mask.contains(a, b);
            prop_assert!(!held || (a != b && a.max(b) < n));
            if clean.is_ok() {
                prop_assert_eq!(held, found.contains(&[a.min(b), a.max(b)]));
            }
        }
        if n > 1_000 {
            return Ok(()); // The naive decoder would write out an order of billions.
        }
        match (clean, naive_decoder::decode(&reply, &shape, n)) {
            (Ok(()), Ok(naive)) => prop_assert_eq!(found.into_iter().collect::<Vec<_>>(), naive),
            (Ok(()), Err(bad)) => prop_assert!(false, "only the naive decoder finds {}", bad),
            (Err(bad), Ok(_)) => prop_assert!(false, "only verify finds {}", bad),
            (Err(_), Err(_)) => {}
        }
    }

}
