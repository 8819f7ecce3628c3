//! Each CPU engine with every instruction set of this machine, through the conformance suite and over all scenes in
//! motion, and what is particular to one of them.

use pairmask_tests::oracle::pair_set_hash;
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};
use proptest::prelude::*;

/// An engine, once for every instruction set that this machine has.
fn each_isa(name: EngineName) -> Vec<(Isa, Box<dyn Engine>)> {
    let engines = Isa::ALL.into_iter().filter_map(|isa| Some((isa, cpu_engine(name, isa).ok()?)));
    let engines: Vec<_> = engines.collect();
    assert!(!engines.is_empty(), "the portable kernel runs everywhere");
    engines
}

fn conforms(name: EngineName, suites: &[Suite]) {
    for (isa, mut engine) in each_isa(name) {
        println!("{isa}");
        for suite in suites {
            conform(engine.as_mut(), suite);
        }
    }
}

/// One thread at every small size, several at some, one and many at sizes with several tasks.
fn suites(large: &[u32]) -> [Suite; 3] {
    let several = vec![0, 1, 64, 511, 513, 1234];
    [
        Suite::default(),
        Suite { sizes: several, threads: vec![2, 4], ..Suite::default() },
        Suite { sizes: large.to_vec(), threads: vec![1, 4], seed: 5, ..Suite::default() },
    ]
}

#[test]
fn all_pairs_conforms() {
    conforms(EngineName::CpuBrute, &suites(&[4096, 4113]));
}

#[test]
fn the_sweep_conforms() {
    conforms(EngineName::CpuSap, &suites(&[4113]));
}

#[test]
fn the_grid_conforms() {
    conforms(EngineName::CpuGrid, &suites(&[2049, 4113]));
}

#[test]
fn the_tree_conforms() {
    conforms(EngineName::CpuTree, &suites(&[1025, 4113, 8192]));
}

#[test]
fn every_scene_in_motion_gives_the_pairs_of_the_oracle() {
    let mut engines = cpu_engines();
    let mut reply = HeapReply::new();
    for name in SceneName::ALL {
        for n in [1, 2, 17, 70, 345, 3000] {
            if name.is_quadratic() && n > 345 {
                continue;
            }
            let mut scene = Scene::new(name, n, 11);
            for frame in 0..4 {
                let truth = oracle::truth(scene.boxes());
                for engine in &mut engines {
                    let input = CullInput::boxes(scene.boxes());
                    let report = engine.cull(&input, &mut reply).expect("memory");
                    check_reply(reply.words(), &report, n as u32, Encoding::Sparse, &truth)
                        .unwrap_or_else(|e| panic!("{name}, {n} boxes, frame {frame}: {e}"));
                }
                // A little, and far.
                (0..[1, 7][frame % 2]).for_each(|_| scene.step());
            }
        }
    }
}

/// The sections of a mask by an engine on so many threads.
fn sections(
    engine: &mut dyn Engine,
    boxes: &[Aabb],
    encoding: Encoding,
    threads: usize,
) -> Vec<u32> {
    let mut reply = HeapReply::new();
    let input = CullInput::boxes(boxes).encoding(encoding).threads(threads);
    let report = pool(threads).install(|| engine.cull(&input, &mut reply)).expect("memory");
    naive_decoder::sections(reply.words(), &report.shape).expect("a good mask")
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_earlier_frames() {
    for engine in EngineName::CPU {
        let mut used = best_engine(engine);
        for name in SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()) {
            let mut scene = Scene::new(name, 20_000, 3);
            for encoding in Encoding::ALL {
                scene.step();
                let expected = sections(best_engine(engine).as_mut(), scene.boxes(), encoding, 1);
                for threads in [2, 4] {
                    let got = sections(used.as_mut(), scene.boxes(), encoding, threads);
                    assert!(got == expected, "{engine}, {name}, {encoding}, {threads} threads");
                }
            }
        }
        for n in [1234, 3, 0, 345, 64, 1234] {
            for scene in stress_scenes::ALL {
                let boxes = scene.boxes(n, 9);
                let expected = sections(best_engine(engine).as_mut(), &boxes, Encoding::Sparse, 1);
                let got = sections(used.as_mut(), &boxes, Encoding::Sparse, 1);
                assert!(got == expected, "{engine}, {scene:?}, {n} boxes");
            }
        }
    }
}

#[test]
fn instruction_sets_rule_out_the_same_pairs_and_a_missing_one_is_a_typed_error() {
    for scene in stress_scenes::ALL {
        let boxes = scene.boxes(1234, 3);
        let skipped = each_isa(EngineName::CpuBrute).into_iter().map(|(_, mut engine)| {
            engine.cull(&CullInput::boxes(&boxes), &mut HeapReply::new()).expect("memory").skipped
        });
        let skipped: Vec<_> = skipped.collect();
        assert!(skipped.windows(2).all(|two| two[0] == two[1]), "{scene:?}: {skipped:?}");
    }
    for isa in Isa::ALL {
        for engine in EngineName::CPU {
            assert_eq!(cpu_engine(engine, isa).is_ok(), isa.is_available());
        }
    }
}

/// Two definitions of overlap agree.
#[test]
fn the_oracle_agrees_with_the_box_type() {
    for scene in stress_scenes::ALL {
        let boxes = scene.boxes(24, 7);
        let overlapping = |a: u32| {
            let overlaps = |b: &u32| boxes[a as usize].overlaps(&boxes[*b as usize]);
            (a + 1..24).filter(overlaps).map(|b| [a, b]).collect::<Vec<_>>()
        };
        let pairs: Vec<_> = (0..24).flat_map(overlapping).collect();
        assert_eq!(oracle::truth(&boxes).pairs, pairs, "{scene:?}");
    }
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
        for (isa, mut engine) in EngineName::CPU.into_iter().flat_map(each_isa) {
            for encoding in Encoding::ALL {
                let input = CullInput::boxes(&boxes).encoding(encoding).threads(threads);
                let checked = check_frame(engine.as_mut(), &input, &truth, &mut HeapReply::new());
                prop_assert_eq!(checked, Ok(()), "{}, {}", engine.name(), isa);
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

/// Engines are held to the oracle, and so to these.
#[test]
fn the_oracles_pair_sets_have_their_golden_hashes() {
    for (name, n, golden) in GOLDEN {
        let truth = oracle::truth(&stress_scenes::named(name).boxes(n, 42));
        let hash = pair_set_hash(&truth.pairs);
        assert_eq!(hash, golden, "{name}: {hash:#018x}");
    }
}

#[test]
fn boxes_on_cell_borders_are_not_lost() {
    // Edges that are the step of a lattice, at offsets where neither is exact: a box's max and
    // the next one's min are the same float and lie on, or an ulp beside, a cell border.
    for origin in [0.0, 0.1, -7.3, 1.0e5, -3.0e7, 1.0e-38, 1.0e30] {
        for step in [1.0f32, 0.1, 1.0 / 3.0, 1.0e-3, 1.0e-40, 1.0e28] {
            let at = |i: i32| (i as f32).mul_add(step, origin);
            let boxes: Vec<Aabb> = (0..1000)
                .map(|i| {
                    let (x, y, z) = (i % 10, i / 10 % 10, i / 100);
                    Aabb::from([at(x), at(y), at(z), at(x + 1), at(y + 1), at(z + 1)])
                })
                .collect();
            let truth = oracle::truth(&boxes);
            let mut reply = HeapReply::new();
            let report = best_engine(EngineName::CpuGrid)
                .cull(&CullInput::boxes(&boxes), &mut reply)
                .expect("memory");
            let pairs = naive_decoder::decode(reply.words(), &report.shape, 1000).expect("a mask");
            check_pairs(&pairs, &truth.pairs).unwrap_or_else(|e| panic!("{origin} {step}: {e}"));
        }
    }
}

#[test]
fn clusters_far_apart_are_not_compared_with_each_other_box_by_box() {
    // 64 clusters along a diagonal: a table over the bounds would put each into one cell.
    let mut boxes = Vec::new();
    for cluster in 0..64 {
        let offset = cluster as f32 * 2.0e4;
        boxes.extend(
            Scene::new(SceneName::Uniform, 300, cluster)
                .boxes()
                .iter()
                .map(|b| Aabb { min: b.min.map(|x| x + offset), max: b.max.map(|x| x + offset) }),
        );
    }
    let mut reply = HeapReply::new();
    let report = best_engine(EngineName::CpuGrid)
        .cull(&CullInput::boxes(&boxes), &mut reply)
        .expect("memory");
    let n = boxes.len() as u32;
    check_reply(reply.words(), &report, n, Encoding::Sparse, &oracle::truth(&boxes))
        .expect("right");
    let all = u64::from(n) * u64::from(n - 1) / 2;
    let compared = all - report.skipped.pairs;
    // One cell a cluster would be 150, one cell for all 9,600.
    assert!(compared < 140 * u64::from(n), "{compared} pairs compared for {n} boxes");
}

#[test]
fn no_scene_is_compared_all_with_all() {
    for name in SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()) {
        let n = 20_000;
        let scene = Scene::new(name, n, 3);
        let mut reply = HeapReply::new();
        let report = best_engine(EngineName::CpuGrid)
            .cull(&CullInput::boxes(scene.boxes()), &mut reply)
            .expect("memory");
        let compared = (n as u64 * (n as u64 - 1) / 2 - report.skipped.pairs) / n as u64;
        assert!(compared < 250, "{name}: {compared} comparisons a box");
    }
}
