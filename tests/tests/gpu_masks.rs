//! The GPU's masks against the naive reference, for every size and every awkward number.

use pairmask::engine::{Census, NAMED_INVALID};
use pairmask::{Aabb, BoxCount, Encoding};
use pairmask_tests::gpu::{awkward, cull, engine, pairs, reference, uniform};
use pairmaskd::execute::gpu::all_pairs::plan::{self, Tuning};
use pairmaskd::execute::gpu::{AllPairs, AllPairsOptions, Checks};

/// The dense string of the reference.
fn dense_reference(n: usize, pairs: &[(u32, u32)]) -> Vec<u32> {
    let mut words = vec![0; BoxCount::new(n as u32).dense_words() as usize];
    for (a, b) in pairs {
        let (n, a, b) = (n as u64, u64::from(*a), u64::from(*b));
        let k = a * (2 * n - a - 1) / 2 + (b - a - 1);
        words[(k / 32) as usize] |= 1 << (k % 32);
    }
    words
}

fn census(boxes: &[Aabb]) -> Census {
    let mut census = Census::default();
    for (b, index) in boxes.iter().zip(0..) {
        census.note(index, b.class());
    }
    census
}

fn check(engine: &mut AllPairs, boxes: &[Aabb]) {
    let n = boxes.len();
    let expected = reference(boxes);
    let (report, reply) = cull(engine, boxes, Encoding::Dense);
    assert!(reply == dense_reference(n, &expected), "dense, {n} boxes");
    assert_eq!(report.pair_count, expected.len() as u64, "{n} boxes");
    assert_eq!(report.census, census(boxes), "{n} boxes");

    let (report, reply) = cull(engine, boxes, Encoding::Sparse);
    // In order of rows and blocks, so as the reference lists them: order is compared too.
    assert!(pairs(n, &report.shape, &reply) == expected, "sparse, {n} boxes");
    assert_eq!(report.pair_count, expected.len() as u64, "{n} boxes");
    assert_eq!(report.census, census(boxes), "{n} boxes");
    assert!(report.census.named_invalid().len() <= NAMED_INVALID);
}

#[test]
fn every_size_from_0_to_70() {
    let mut engine = engine(AllPairsOptions::default());
    for n in 0..=70 {
        check(&mut engine, &awkward(n, 1));
        check(&mut engine, &uniform(n, 2));
    }
}

#[test]
fn odd_and_large_sizes() {
    let mut engine = engine(AllPairsOptions::default());
    for n in [255, 256, 257, 345, 511, 1234, 2049, 4096] {
        check(&mut engine, &awkward(n, 3));
        check(&mut engine, &uniform(n, 4));
    }
    // Back to a small scene: no frame, mask or total of the large one may show.
    check(&mut engine, &awkward(33, 5));
}

#[test]
fn ten_thousand_boxes() {
    let mut engine = engine(AllPairsOptions::default());
    check(&mut engine, &uniform(10_000, 6));
}

#[test]
fn everything_overlaps_so_the_first_capacity_does_not_do() {
    let mut engine = engine(AllPairsOptions::default());
    let boxes = vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; 1234];
    let n = BoxCount::new(1234);
    assert!(plan::possible_words(n) > plan::first_capacity(n), "or the test shows nothing");
    check(&mut engine, &boxes);
    let (report, _) = cull(&mut engine, &boxes, Encoding::Sparse);
    assert_eq!((report.pair_count, report.skipped.zero_words), (n.pair_count(), 0));
}

#[test]
fn many_bands_give_the_same_bytes_as_one() {
    // 64 KiB of matrix: one batch of rows a band at most sizes.
    let narrow = AllPairsOptions { matrix_bytes: Some(64 << 10), ..Default::default() };
    let mut narrow = engine(narrow);
    let mut wide = engine(AllPairsOptions::default());
    for n in [70, 345, 700, 1000] {
        check(&mut narrow, &awkward(n, 7));
    }
    for encoding in [Encoding::Dense, Encoding::Sparse] {
        let boxes = awkward(1000, 8);
        let (a, b) = (cull(&mut narrow, &boxes, encoding), cull(&mut wide, &boxes, encoding));
        assert_eq!((a.0.shape, a.0.census), (b.0.shape, b.0.census));
        assert_eq!(pairs(1000, &a.0.shape, &a.1), pairs(1000, &b.0.shape, &b.1));
    }
    // More bands than one submission holds.
    let matrix_bytes = Some(2 * 256 * 4 * 6000_u64.div_ceil(32).next_multiple_of(16));
    let mut narrow = engine(AllPairsOptions { matrix_bytes, ..Default::default() });
    let boxes = uniform(6000, 9);
    let (report, reply) = cull(&mut narrow, &boxes, Encoding::Dense);
    assert!(pairs(6000, &report.shape, &reply) == reference(&boxes));
}

#[test]
fn every_tuning_gives_the_same_pairs() {
    let boxes = awkward(700, 10);
    for tuning in Tuning::all() {
        let mut engine = engine(AllPairsOptions { tuning: Some(tuning), ..Default::default() });
        check(&mut engine, &boxes);
        check(&mut engine, &boxes[..33]);
    }
}

#[test]
fn checked_and_unchecked_stages_give_the_same_bytes() {
    let mut checked = engine(AllPairsOptions { checks: Checks::On, ..Default::default() });
    let mut unchecked = engine(AllPairsOptions::default());
    for n in [2, 31, 33, 345, 1234] {
        let boxes = awkward(n, 11);
        for encoding in [Encoding::Dense, Encoding::Sparse] {
            let a = cull(&mut checked, &boxes, encoding);
            let b = cull(&mut unchecked, &boxes, encoding);
            assert_eq!(a.0.shape, b.0.shape);
            assert!(used(&a.0.shape, &a.1) == used(&b.0.shape, &b.1), "{n} {encoding}");
        }
        check(&mut checked, &boxes);
    }
}

/// The words of a reply that belong to the mask.
fn used<'a>(shape: &pairmask::mask::MaskShape, reply: &'a [u32]) -> Vec<&'a [u32]> {
    use pairmask::mask::MaskShape;
    let spans = match shape {
        MaskShape::Dense { words } => vec![*words],
        MaskShape::Sparse { rows, blocks, bits, .. } => vec![*rows, *blocks, *bits],
    };
    spans.iter().map(|span| span.of(reply).expect("within the reply")).collect()
}

#[test]
fn the_comparison_notices_one_flipped_bit() {
    let boxes = uniform(345, 12);
    let expected = reference(&boxes);
    let mut engine = engine(AllPairsOptions::default());
    let (report, mut reply) = cull(&mut engine, &boxes, Encoding::Dense);
    assert!(pairs(345, &report.shape, &reply) == expected);
    reply[100] ^= 1 << 7;
    assert!(pairs(345, &report.shape, &reply) != expected);
}
