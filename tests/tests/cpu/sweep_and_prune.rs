//! `cpu-sap`, every instruction set of this machine, through the conformance suite and over all
//! scenes in motion.

use pairmask_core::Encoding;
use pairmask_core::engine::{CullInput, Engine, HeapReply, Isa, SweepAndPrune};
use pairmask_tests::conformance::{Suite, check_engine, check_reply};
use pairmask_tests::{naive_decoder, oracle};
use pairmaskd::scene::{Scene, SceneName};
use rayon::ThreadPoolBuilder;

fn run(suite: &Suite) {
    let mut ran = 0;
    for isa in Isa::ALL {
        let Ok(mut engine) = SweepAndPrune::with_isa(isa) else { continue };
        match check_engine(&mut engine, suite) {
            Ok(frames) => ran += frames,
            Err(failure) => panic!("{isa}: {failure}"),
        }
    }
    assert!(ran > 0, "the suite ran nothing");
}

#[test]
fn conforms_on_one_thread() {
    run(&Suite::default());
}

#[test]
fn conforms_on_two_and_four_threads() {
    run(&Suite { sizes: vec![0, 64, 1234, 4113], threads: vec![2, 4], ..Suite::default() });
}

#[test]
fn every_scene_in_motion_gives_the_pairs_of_the_oracle() {
    let mut engine = SweepAndPrune::new();
    let mut reply = HeapReply::new();
    for name in SceneName::ALL {
        for n in [2, 70, 345, 3000] {
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
                scene.step();
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_the_order_kept_from_earlier_frames() {
    let mut used = SweepAndPrune::new();
    for name in SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()) {
        let mut scene = Scene::new(name, 3000, 3);
        for threads in [1, 2, 4] {
            scene.step();
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let sections = |engine: &mut SweepAndPrune, threads: usize| {
                let mut reply = HeapReply::new();
                let report = pool
                    .install(|| {
                        engine.cull(&CullInput::boxes(scene.boxes()).threads(threads), &mut reply)
                    })
                    .expect("memory");
                naive_decoder::sections(reply.words(), &report.shape).expect("a good mask")
            };
            let expected = sections(&mut SweepAndPrune::new(), 1);
            assert!(sections(&mut used, threads) == expected, "{name}, {threads} threads");
        }
    }
}
