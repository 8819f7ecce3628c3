//! Every comparator of the conformance suite notices the mistakes that it is for.

use pairmask_core::engine::{
    BruteForce, CullError, CullInput, CullReport, Engine, HeapReply, ReplyBuffer, ReserveError,
};
use pairmask_core::mask::MaskShape;
use pairmask_core::{Aabb, Encoding, EngineName};
use pairmask_lab::sabotage::Spoiler;
use pairmask_tests::conformance::{Mismatch, Suite, check_engine, check_frame, check_pairs};
use pairmask_tests::naive_decoder::BadMask;
use pairmask_tests::{oracle, stress_scenes};

/// An engine that spoils a right answer.
fn spoiler<S>(spoil: S) -> Spoiler<S> {
    Spoiler { engine: Box::new(BruteForce::new()), spoil }
}

fn boxes() -> Vec<Aabb> {
    let uniform = stress_scenes::ALL.iter().find(|s| s.name() == "uniform");
    let mut boxes = uniform.expect("it is listed").boxes(345, 11);
    boxes[7] = Aabb::EMPTY;
    boxes[9].min[0] = f32::NAN;
    boxes
}

/// The suite's verdict on a spoilt answer.
fn verdict(
    encoding: Encoding,
    spoil: impl FnMut(&mut [u32], &mut CullReport) + Send,
) -> Result<(), Mismatch> {
    let boxes = boxes();
    let truth = oracle::truth(&boxes);
    check_frame(
        &mut spoiler(spoil),
        &CullInput::boxes(&boxes).encoding(encoding),
        &truth,
        &mut HeapReply::new(),
    )
}

fn dense(spoil: impl FnMut(&mut [u32], &mut CullReport) + Send) -> Result<(), Mismatch> {
    verdict(Encoding::Dense, spoil)
}

fn sparse(spoil: impl FnMut(&mut [u32], &mut CullReport) + Send) -> Result<(), Mismatch> {
    verdict(Encoding::Sparse, spoil)
}

fn list(spoil: impl FnMut(&mut [u32], &mut CullReport) + Send) -> Result<(), Mismatch> {
    verdict(Encoding::List, spoil)
}

/// First word of the `bits` section.
fn bits_start(report: &CullReport) -> usize {
    match report.shape {
        MaskShape::Sparse { bits, .. } => bits.start as usize,
        MaskShape::Dense { words } => words.start as usize,
        shape => panic!("which words of {shape:?} are bits of pairs?"),
    }
}

#[test]
fn a_right_answer_passes() {
    assert_eq!(dense(|_, _| {}), Ok(()));
    assert_eq!(sparse(|_, _| {}), Ok(()));
    assert_eq!(list(|_, _| {}), Ok(()));
}

#[test]
fn one_bit_that_is_lost_or_made_up_is_noticed() {
    let lost = dense(|words, _| {
        let word = words.iter_mut().find(|w| **w != 0).expect("a pair");
        *word &= *word - 1;
    });
    assert!(matches!(lost, Err(Mismatch::Missing(_))), "{lost:?}");
    let made_up = dense(|words, _| *words.iter_mut().find(|w| **w == 0).expect("a gap") = 1 << 31);
    assert!(matches!(made_up, Err(Mismatch::Extra(_))), "{made_up:?}");
}

#[test]
fn a_swap_that_keeps_the_count_is_noticed() {
    let swapped = dense(|words, _| {
        let at = words.iter().position(|w| *w != 0 && *w != !0).expect("a pair");
        words[at] = words[at].rotate_left(1);
    });
    assert!(matches!(swapped, Err(Mismatch::Missing(_) | Mismatch::Extra(_))), "{swapped:?}");
}

#[test]
fn a_sparse_word_that_is_dropped_is_noticed() {
    let dropped = sparse(|_, report| {
        if let MaskShape::Sparse { rows, blocks, bits, .. } = &mut report.shape {
            for span in [rows, blocks, bits] {
                span.len -= 1;
            }
        }
    });
    assert!(matches!(dropped, Err(Mismatch::Missing(_))), "{dropped:?}");
}

#[test]
fn a_pair_that_is_named_twice_is_noticed() {
    let doubled = sparse(|words, report| {
        if let MaskShape::Sparse { rows, blocks, bits, .. } = report.shape {
            for span in [rows, blocks, bits] {
                words[span.start as usize + 1] = words[span.start as usize];
            }
        }
    });
    assert_eq!(doubled, Err(Mismatch::Mask(BadMask::Unsorted(1))));
}

#[test]
fn a_spoilt_list_is_noticed() {
    let dropped = list(|_, report| {
        if let MaskShape::List { pairs } = &mut report.shape {
            pairs.len -= 2;
        }
    });
    assert!(matches!(dropped, Err(Mismatch::Missing(_))), "{dropped:?}");
    let half = list(|_, report| {
        if let MaskShape::List { pairs } = &mut report.shape {
            pairs.len -= 1;
        }
    });
    assert!(matches!(half, Err(Mismatch::Mask(BadMask::HalfPair(_)))), "{half:?}");
    let doubled = list(|words, _| words.copy_within(0..2, 2));
    assert!(matches!(doubled, Err(Mismatch::Mask(BadMask::Doubled(_)))), "{doubled:?}");
    let turned = list(|words, _| words.swap(2, 3));
    assert!(
        matches!(turned, Err(Mismatch::Mask(BadMask::NotAPair { number: 1, .. }))),
        "{turned:?}"
    );
    let beyond = list(|words, _| words[1] = 345);
    assert!(
        matches!(beyond, Err(Mismatch::Mask(BadMask::NotAPair { number: 0, .. }))),
        "{beyond:?}"
    );
    // Box 7 is empty, and overlaps nothing.
    let made_up = list(|words, _| words[..2].copy_from_slice(&[7, 8]));
    assert!(matches!(made_up, Err(Mismatch::Missing(_) | Mismatch::Extra(_))), "{made_up:?}");
}

#[test]
fn a_zero_word_is_noticed() {
    let zero = sparse(|words, report| words[bits_start(report)] = 0);
    assert_eq!(zero, Err(Mismatch::Mask(BadMask::ZeroWord(0))));
}

#[test]
fn a_dirty_tail_is_noticed() {
    // 345 boxes have 59,340 pairs, so that the last word uses 12 bits.
    let dirty = dense(|words, _| *words.last_mut().expect("words") |= 1 << 31);
    assert!(matches!(dirty, Err(Mismatch::Mask(BadMask::DirtyTail(_)))), "{dirty:?}");
}

#[test]
fn the_other_encoding_is_noticed() {
    let boxes = boxes();
    let truth = oracle::truth(&boxes);
    let mut reply = HeapReply::new();
    let report = BruteForce::new()
        .cull(&CullInput::boxes(&boxes).encoding(Encoding::Dense), &mut reply)
        .expect("memory");
    let (n, asked) = (boxes.len() as u32, Encoding::Sparse);
    let other = pairmask_tests::conformance::check_reply(reply.words(), &report, n, asked, &truth);
    assert_eq!(other, Err(Mismatch::Encoding { asked, got: Encoding::Dense }));
}

#[test]
fn wrong_reports_are_noticed() {
    let count = sparse(|_, report| report.pair_count += 1);
    assert!(matches!(count, Err(Mismatch::PairCount { .. })), "{count:?}");
    for spoil in [
        (|report| report.census.invalid += 1) as fn(&mut CullReport),
        |report| report.census.empty -= 1,
        |report| report.census.first_invalid[0] = 8,
    ] {
        let census = sparse(|_, report| spoil(report));
        assert!(matches!(census, Err(Mismatch::Census { .. })), "{census:?}");
    }
    for spoil in [
        (|report| report.skipped.boxes += 1) as fn(&mut CullReport),
        |report| report.skipped.pairs = u64::MAX,
        |report| report.skipped.pairs = 345 * 344 / 2,
        |report| report.skipped.zero_words = u64::MAX,
        |report| report.skipped.why.axis += 1,
    ] {
        let skip = sparse(|_, report| spoil(report));
        assert!(matches!(skip, Err(Mismatch::Skip { .. })), "{skip:?}");
    }
    let zero_words = dense(|_, report| report.skipped.zero_words = 1);
    assert!(matches!(zero_words, Err(Mismatch::Skip { .. })), "{zero_words:?}");
}

#[test]
fn a_second_run_that_differs_is_noticed() {
    let mut runs = 0;
    let mask = sparse(|words, report| {
        runs += 1;
        words[bits_start(report)] ^= u32::from(runs == 2) << 31;
    });
    assert!(matches!(mask, Err(Mismatch::NotDeterministic(_))), "{mask:?}");
    let mut runs = 0;
    let report = sparse(|_, report| {
        runs += 1;
        report.pair_count += u64::from(runs == 1);
    });
    assert_eq!(report, Err(Mismatch::ReportNotDeterministic));
}

#[test]
fn a_word_that_is_not_written_is_noticed() {
    /// Leaves the reply memory as it was handed out.
    struct Lazy;
    impl Engine for Lazy {
        fn name(&self) -> EngineName {
            EngineName::CpuBrute
        }
        fn cull(
            &mut self,
            input: &CullInput<'_>,
            reply: &mut dyn ReplyBuffer,
        ) -> Result<CullReport, CullError> {
            let report = BruteForce::new().cull(input, &mut HeapReply::new())?;
            reply.reserve(report.shape.extent_words())?;
            Ok(report)
        }
    }
    // Boxes apart: an all-zero mask would be right.
    let boxes: Vec<Aabb> = (0..70)
        .map(|i| Aabb::from([2.0 * i as f32, 0.0, 0.0, 2.0 * i as f32 + 1.0, 1.0, 1.0]))
        .collect();
    let truth = oracle::truth(&boxes);
    let unwritten = check_frame(
        &mut Lazy,
        &CullInput::boxes(&boxes).encoding(Encoding::Dense),
        &truth,
        &mut HeapReply::new(),
    );
    assert_eq!(unwritten, Err(Mismatch::NotDeterministic(0)));
}

#[test]
fn an_engine_that_gives_no_answer_fails() {
    struct Refuses;
    impl ReplyBuffer for Refuses {
        fn limit_words(&self) -> u64 {
            u64::MAX
        }

        fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
            Err(ReserveError::OutOfMemory { needed_bytes: 4 * words })
        }
    }
    let refused =
        BruteForce::new().cull(&CullInput::boxes(&boxes()).encoding(Encoding::Dense), &mut Refuses);
    assert!(matches!(refused, Err(CullError::Reserve(ReserveError::OutOfMemory { .. }))));
}

#[test]
fn pair_lists_are_compared_as_sets() {
    let expected = [(0, 1), (0, 2), (4, 5)];
    assert_eq!(check_pairs(&expected, &expected), Ok(()));
    assert_eq!(check_pairs(&expected[..2], &expected), Err(Mismatch::Missing((4, 5))));
    assert_eq!(check_pairs(&expected[1..], &expected), Err(Mismatch::Missing((0, 1))));
    assert_eq!(check_pairs(&expected, &expected[..2]), Err(Mismatch::Extra((4, 5))));
    assert_eq!(check_pairs(&[(0, 1), (0, 3)], &[(0, 1), (0, 2)]), Err(Mismatch::Missing((0, 2))));
    assert_eq!(check_pairs(&[(0, 1)], &[]), Err(Mismatch::Extra((0, 1))));
}

#[test]
fn a_failure_names_the_frame() {
    let suite = Suite { sizes: vec![8], ..Suite::default() };
    let failure =
        check_engine(&mut spoiler(|_: &mut [u32], r: &mut CullReport| r.pair_count = 1), &suite)
            .expect_err("28 identical pairs are not 1");
    assert_eq!((failure.scene, failure.n), ("identical", 8));
    let message = failure.to_string();
    assert!(message.contains("cpu-brute, scene 'identical', 8 boxes, dense"), "{message}");
}
