//! `cpu-grid`, every instruction set of this machine, through the conformance suite and over all
//! scenes in motion.

use pairmask_core::engine::{CullInput, Engine, Grid, HeapReply, Isa};
use pairmask_core::{Aabb, Encoding};
use pairmask_tests::conformance::{Suite, check_engine, check_pairs, check_reply};
use pairmask_tests::{naive_decoder, oracle, stress_scenes};
use pairmaskd::scene::{Scene, SceneName};
use rayon::ThreadPoolBuilder;

fn engines() -> Vec<(Isa, Grid)> {
    let engines: Vec<_> =
        Isa::ALL.into_iter().filter_map(|isa| Some((isa, Grid::with_isa(isa).ok()?))).collect();
    assert!(!engines.is_empty(), "the portable kernel runs everywhere");
    engines
}

fn run(suite: &Suite) {
    for (isa, mut engine) in engines() {
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
    run(&Suite { sizes: vec![0, 64, 1234, 2049, 4113], threads: vec![2, 4], ..Suite::default() });
}

/// The pairs of one frame, from a mask that was checked.
fn cull(engine: &mut Grid, boxes: &[Aabb], encoding: Encoding, threads: usize) -> Vec<u32> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    let mut reply = HeapReply::new();
    let report = pool
        .install(|| {
            engine.cull(&CullInput::boxes(boxes).encoding(encoding).threads(threads), &mut reply)
        })
        .expect("memory");
    naive_decoder::sections(reply.words(), &report.shape).expect("a good mask")
}

#[test]
fn every_scene_in_motion_gives_the_pairs_of_the_oracle() {
    let mut engine = Grid::new();
    let mut reply = HeapReply::new();
    for name in SceneName::ALL {
        for n in [1, 2, 17, 70, 345, 3000] {
            if name.is_quadratic() && n > 345 {
                continue;
            }
            let mut scene = Scene::new(name, n, 11);
            for frame in 0..3 {
                let truth = oracle::truth(scene.boxes());
                let report =
                    engine.cull(&CullInput::boxes(scene.boxes()), &mut reply).expect("memory");
                check_reply(reply.words(), &report, n as u32, Encoding::Sparse, &truth)
                    .unwrap_or_else(|e| panic!("{name}, {n} boxes, frame {frame}: {e}"));
                (0..7).for_each(|_| scene.step());
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_earlier_frames() {
    let mut used = Grid::new();
    for name in SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()) {
        for n in [2500, 20_000] {
            let mut scene = Scene::new(name, n, 3);
            scene.step();
            for encoding in [Encoding::Sparse, Encoding::List] {
                let expected = cull(&mut Grid::new(), scene.boxes(), encoding, 1);
                for threads in [1, 2, 4] {
                    let got = cull(&mut used, scene.boxes(), encoding, threads);
                    assert!(got == expected, "{name}, {n}, {encoding}, {threads} threads");
                }
            }
        }
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
            let report = Grid::new().cull(&CullInput::boxes(&boxes), &mut reply).expect("memory");
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
    let report = Grid::new().cull(&CullInput::boxes(&boxes), &mut reply).expect("memory");
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
        let report =
            Grid::new().cull(&CullInput::boxes(scene.boxes()), &mut reply).expect("memory");
        let compared = (n as u64 * (n as u64 - 1) / 2 - report.skipped.pairs) / n as u64;
        assert!(compared < 250, "{name}: {compared} comparisons a box");
    }
}

#[test]
fn a_frame_does_not_depend_on_the_stress_frames_before_it() {
    let mut used = Grid::new();
    for n in [1234, 3, 0, 345, 64, 1234] {
        for scene in stress_scenes::ALL {
            let boxes = scene.boxes(n, 9);
            let expected = cull(&mut Grid::new(), &boxes, Encoding::Sparse, 1);
            assert!(cull(&mut used, &boxes, Encoding::Sparse, 1) == expected, "{scene:?}, {n}");
        }
    }
}
