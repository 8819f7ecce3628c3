//! `cpu-brute`, every instruction set of this machine, through the conformance suite.

use pairmask_core::engine::{BruteForce, CullInput, Engine, HeapReply, Isa};
use pairmask_core::{Aabb, Encoding};
use pairmask_tests::conformance::{Suite, check_engine, check_frame};
use pairmask_tests::oracle::{self, pair_set_hash};
use pairmask_tests::{naive_decoder, stress_scenes};
use proptest::prelude::*;
use rayon::ThreadPoolBuilder;

/// The engine, once for every instruction set that this machine has.
fn engines() -> Vec<BruteForce> {
    let engines: Vec<_> =
        Isa::ALL.into_iter().filter_map(|isa| BruteForce::with_isa(isa).ok()).collect();
    assert!(!engines.is_empty(), "the portable kernel runs everywhere");
    engines
}

fn run(suite: &Suite) {
    for mut engine in engines() {
        let isa = engine.isa();
        match check_engine(&mut engine, suite) {
            Ok(frames) => assert!(frames > 0, "the suite ran nothing"),
            Err(failure) => panic!("{isa}: {failure}"),
        }
    }
}

#[test]
fn conforms_on_one_thread() {
    run(&Suite::default());
}

#[test]
fn conforms_on_two_and_four_threads() {
    run(&Suite { sizes: vec![0, 1, 64, 511, 513, 1234], threads: vec![2, 4], ..Suite::default() });
}

#[test]
fn conforms_on_large_scenes() {
    run(&Suite { sizes: vec![4096, 4113], threads: vec![1, 2], seed: 5, ..Suite::default() });
}

#[test]
fn instruction_sets_rule_out_the_same_pairs() {
    for scene in stress_scenes::ALL {
        let boxes = scene.boxes(1234, 3);
        let skipped: Vec<_> = engines()
            .iter_mut()
            .map(|engine| {
                engine
                    .cull(&CullInput::boxes(&boxes), &mut HeapReply::new())
                    .expect("memory")
                    .skipped
            })
            .collect();
        assert!(skipped.windows(2).all(|two| two[0] == two[1]), "{scene:?}: {skipped:?}");
    }
}

#[test]
fn an_instruction_set_that_is_missing_is_a_typed_error() {
    for isa in Isa::ALL {
        assert_eq!(BruteForce::with_isa(isa).is_ok(), isa.is_available());
    }
}

#[test]
fn a_frame_does_not_depend_on_the_frames_before_it() {
    let mut engine = BruteForce::new();
    let mut reply = HeapReply::new();
    for n in [1234, 3, 0, 345, 64, 1234] {
        for scene in stress_scenes::ALL {
            let boxes = scene.boxes(n, 9);
            let report = engine.cull(&CullInput::boxes(&boxes), &mut reply).expect("memory");
            let used = pairs(&reply, &report, n);
            let report =
                BruteForce::new().cull(&CullInput::boxes(&boxes), &mut reply).expect("memory");
            assert_eq!(used, pairs(&reply, &report, n), "{scene:?}, {n} boxes");
        }
    }
}

fn pairs(
    reply: &HeapReply,
    report: &pairmask_core::engine::CullReport,
    n: u32,
) -> Vec<oracle::Pair> {
    naive_decoder::decode(reply.words(), &report.shape, n).expect("a good mask")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Coordinates from few numbers often touch and coincide.
    #[test]
    fn any_boxes_give_the_pairs_of_the_oracle(
        boxes in prop::collection::vec(prop::array::uniform6(-4i8..5), 0..300),
        step in prop::sample::select(vec![1.0f32, 0.1, 1e-45, 1e38, f32::INFINITY]),
        threads in 1usize..4,
    ) {
        let boxes: Vec<Aabb> =
            boxes.into_iter().map(|b| Aabb::from(b.map(|x| f32::from(x) * step))).collect();
        let truth = oracle::truth(&boxes);
        for mut engine in engines() {
            for encoding in Encoding::ALL {
                let checked =
                    check_frame(&mut engine, &CullInput::boxes(&boxes).encoding(encoding).threads(threads), &truth, &mut HeapReply::new());
                prop_assert_eq!(checked, Ok(()), "{}", engine.isa());
            }
        }
    }
}

/// Scene, boxes, and the hash of its pairs. A new value here needs a reason in its commit: either
/// the scene changed, or the meaning of "overlap" did.
const GOLDEN: [(&str, u32, u64); 6] = [
    ("uniform", 1234, 0x8027_e2a9_f50c_a5bf),
    ("clustered", 345, 0x3ba3_86e6_9d94_3338),
    ("lattice", 1234, 0x9229_92d5_0cb7_21c2),
    ("infinite", 345, 0xd9cb_dfd5_5986_0507),
    ("random key order", 345, 0x6ab8_0c14_f90e_5712),
    ("ulp-adjacent faces", 70, 0xb3a2_c02f_8677_0250),
];

#[test]
fn pair_sets_have_their_golden_hashes_on_every_thread_count() {
    for (name, n, golden) in GOLDEN {
        let scene = stress_scenes::ALL.iter().find(|s| s.name() == name).expect("it is listed");
        let boxes: Vec<Aabb> = scene.boxes(n, 42);
        let truth = pair_set_hash(&oracle::truth(&boxes).pairs);
        assert_eq!(truth, golden, "oracle, {name}: {truth:#018x}");
        for threads in [1, 2, 4] {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            for mut engine in engines() {
                for encoding in Encoding::ALL {
                    let mut reply = HeapReply::new();
                    let report = pool
                        .install(|| {
                            engine.cull(
                                &CullInput::boxes(&boxes).encoding(encoding).threads(threads),
                                &mut reply,
                            )
                        })
                        .expect("memory");
                    let hash = pair_set_hash(&pairs(&reply, &report, n));
                    assert_eq!(hash, golden, "{}, {name}, {threads} threads", engine.isa());
                }
            }
        }
    }
}
