//! Every comparator of the conformance suite notices the mistakes that it is for.

use pairmask_lab::sabotage::Spoiler;
use pairmask_tests::conformance::check_engine;
use pairmask_tests::prelude::*;

fn spoiler<S>(spoil: S) -> Spoiler<S> {
    Spoiler { engine: best_engine(EngineName::CpuBrute), spoil }
}

fn boxes() -> Vec<Aabb> {
    let mut boxes = stress_scenes::named("uniform").boxes(345, 11);
    boxes[7] = Aabb::EMPTY;
    boxes[9].min[0] = f32::NAN;
    boxes
}

fn verdict(
    encoding: Encoding,
    spoil: impl FnMut(&mut [u32], &mut CullReport) + Send,
) -> Result<(), Mismatch> {
    let boxes = boxes();
    let truth = oracle::truth(&boxes);
    let input = CullInput::boxes(&boxes).encoding(encoding);
    check_frame(&mut spoiler(spoil), &input, &truth, &mut HeapReply::new())
}

/// First word of the `bits` section.
fn bits_start(report: &CullReport) -> usize {
    match report.shape {
        MaskShape::Sparse { bits, .. } => bits.start as usize,
        MaskShape::Dense { words } => words.start as usize,
        shape => panic!("which words of {shape:?} are bits of pairs?"),
    }
}

/// Takes words off each section of a sparse mask, or off a list.
fn shorten(report: &mut CullReport, by: u64) {
    match &mut report.shape {
        MaskShape::Sparse { rows, blocks, bits, .. } => {
            for span in [rows, blocks, bits] {
                span.len -= by;
            }
        }
        MaskShape::List { pairs } => pairs.len -= by,
        shape => panic!("{shape:?}"),
    }
}

/// Says that a dense mask begins off the grid.
fn shift(report: &mut CullReport) {
    if let MaskShape::Dense { words } = &mut report.shape {
        (words.start, words.len) = (8, words.len - 8);
    }
}

fn double(words: &mut [u32], report: &CullReport) {
    if let MaskShape::Sparse { rows, blocks, bits, .. } = report.shape {
        for span in [rows, blocks, bits] {
            words[span.start as usize + 1] = words[span.start as usize];
        }
    }
}

const DENSE: Encoding = Encoding::Dense;
const SPARSE: Encoding = Encoding::Sparse;
const LIST: Encoding = Encoding::List;

/// An encoding, how what is noticed begins (one of some), and what is done to the answer.
type Case = (Encoding, &'static [&'static str], fn(&mut [u32], &mut CullReport));

const CASES: [Case; 25] = [
    (DENSE, &["Unaligned"], |_, report| shift(report)),
    (LIST, &["Mask(OutsideReply"], |_, report| {
        if let MaskShape::List { pairs } = &mut report.shape {
            pairs.len = u64::MAX;
        }
    }),
    (DENSE, &["Missing"], |words, _| {
        let word = words.iter_mut().find(|w| **w != 0).expect("a pair");
        *word &= *word - 1;
    }),
    (DENSE, &["Extra"], |words, _| *words.iter_mut().find(|w| **w == 0).expect("a gap") = 1 << 31),
    // The count stays.
    (DENSE, &["Missing", "Extra"], |words, _| {
        let at = words.iter().position(|w| *w != 0 && *w != !0).expect("a pair");
        words[at] = words[at].rotate_left(1);
    }),
    // 345 boxes have 59,340 pairs, so that the last word uses 12 bits.
    (DENSE, &["Mask(TailBits"], |words, _| *words.last_mut().expect("words") |= 1 << 31),
    (SPARSE, &["Missing"], |_, report| shorten(report, 1)),
    (SPARSE, &["Mask(NotSorted { word: 1 })"], |words, report| double(words, report)),
    (SPARSE, &["Mask(ZeroWord { word: 0 })"], |words, report| words[bits_start(report)] = 0),
    (LIST, &["Missing"], |_, report| shorten(report, 2)),
    (LIST, &["Mask(HalfPair"], |_, report| shorten(report, 1)),
    (LIST, &["Mask(PairAgain"], |words, _| words.copy_within(0..2, 2)),
    (LIST, &["Mask(NotAPair { number: 1"], |words, _| words.swap(2, 3)),
    (LIST, &["Mask(NotAPair { number: 0"], |words, _| words[1] = 345),
    // Box 7 is empty, and overlaps nothing.
    (LIST, &["Missing", "Extra"], |words, _| words[..2].copy_from_slice(&[7, 8])),
    (SPARSE, &["PairCount"], |_, report| report.pair_count += 1),
    (SPARSE, &["Census"], |_, report| report.census.invalid += 1),
    (SPARSE, &["Census"], |_, report| report.census.empty -= 1),
    (SPARSE, &["Census"], |_, report| report.census.first_invalid[0] = 8),
    (SPARSE, &["Skip"], |_, report| report.skipped.boxes += 1),
    (SPARSE, &["Skip"], |_, report| report.skipped.pairs = 345 * 344 / 2),
    (SPARSE, &["Skip"], |_, report| report.skipped.pairs = u64::MAX),
    (SPARSE, &["Skip"], |_, report| report.skipped.zero_words = u64::MAX),
    (SPARSE, &["Skip"], |_, report| report.skipped.why.axis += 1),
    (DENSE, &["Skip"], |_, report| report.skipped.zero_words = 1),
];

#[test]
fn each_spoilt_answer_is_noticed_and_a_right_one_passes() {
    for encoding in Encoding::ALL {
        assert_eq!(verdict(encoding, |_, _| {}), Ok(()));
    }
    for (encoding, begins, spoil) in CASES {
        let said = verdict(encoding, spoil).map_err(|mismatch| format!("{mismatch:?}"));
        let is_noticed = |said: &String| begins.iter().any(|begin| said.starts_with(begin));
        assert!(said.as_ref().is_err_and(is_noticed), "{begins:?}: {said:?}");
    }
}

#[test]
fn the_other_encoding_is_noticed() {
    let boxes = boxes();
    let truth = oracle::truth(&boxes);
    let mut reply = HeapReply::new();
    let input = CullInput::boxes(&boxes).encoding(Encoding::Dense);
    let report = best_engine(EngineName::CpuBrute).cull(&input, &mut reply).expect("memory");
    let other = check_reply(reply.words(), &report, 345, SPARSE, &truth);
    assert_eq!(other, Err(Mismatch::Encoding { asked: SPARSE, got: DENSE }));
}

#[test]
fn a_second_run_that_differs_is_noticed() {
    let mut runs = 0;
    let mask = verdict(SPARSE, |words, report| {
        runs += 1;
        words[bits_start(report)] ^= u32::from(runs == 2) << 31;
    });
    assert!(matches!(mask, Err(Mismatch::NotDeterministic(_))), "{mask:?}");
    let mut runs = 0;
    let report = verdict(SPARSE, |_, report| {
        runs += 1;
        report.pair_count += u64::from(runs == 1);
    });
    assert_eq!(report, Err(Mismatch::ReportNotDeterministic));
}

#[test]
fn a_word_that_is_not_written_is_noticed() {
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
            let report = best_engine(EngineName::CpuBrute).cull(input, &mut HeapReply::new())?;
            reply.reserve(report.shape.extent_words())?;
            Ok(report)
        }
    }
    // Boxes apart: an all-zero mask would be right.
    let boxes: Vec<Aabb> = (0..70)
        .map(|i| Aabb::from([2.0 * i as f32, 0.0, 0.0, 2.0 * i as f32 + 1.0, 1.0, 1.0]))
        .collect();
    let truth = oracle::truth(&boxes);
    let input = CullInput::boxes(&boxes).encoding(Encoding::Dense);
    let unwritten = check_frame(&mut Lazy, &input, &truth, &mut HeapReply::new());
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
    let refused = best_engine(EngineName::CpuBrute).cull(&CullInput::boxes(&boxes()), &mut Refuses);
    assert!(matches!(refused, Err(CullError::Reserve(ReserveError::OutOfMemory { .. }))));
}

#[test]
fn pair_lists_are_compared_as_sets() {
    let expected = [[0, 1], [0, 2], [4, 5]];
    assert_eq!(check_pairs(&expected, &expected), Ok(()));
    assert_eq!(check_pairs(&expected[..2], &expected), Err(Mismatch::Missing([4, 5])));
    assert_eq!(check_pairs(&expected[1..], &expected), Err(Mismatch::Missing([0, 1])));
    assert_eq!(check_pairs(&expected, &expected[..2]), Err(Mismatch::Extra([4, 5])));
    assert_eq!(check_pairs(&[[0, 1], [0, 3]], &[[0, 1], [0, 2]]), Err(Mismatch::Missing([0, 2])));
    assert_eq!(check_pairs(&[[0, 1]], &[]), Err(Mismatch::Extra([0, 1])));
    assert_eq!(check_pairs(&[[0, 1], [0, 1]], &[[0, 1]]), Err(Mismatch::Extra([0, 1])));
}

#[test]
fn a_failure_names_the_frame() {
    let suite = Suite { sizes: vec![8], ..Suite::default() };
    let failure =
        check_engine(&mut spoiler(|_: &mut [u32], r: &mut CullReport| r.pair_count = 1), &suite)
            .expect_err("28 identical pairs are not 1");
    assert!(failure.contains("cpu-brute, scene 'identical', 8 boxes, dense"), "{failure}");
}
