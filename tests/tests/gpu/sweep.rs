//! The laboratory's sweep on a GPU through the conformance suite, on hard scenes, and on scenes that crowd its axis.

use pairmask_core::engine::Grid as CpuGrid;
use pairmask_lab::study::sweep::{GpuSweep, SweepError, SweepScene};
use pairmask_tests::gpu::open;
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{Checks, HostImport};

fn sweep(checks: Checks) -> GpuSweep {
    GpuSweep::new(&open(HostImport::IfPossible), checks).unwrap_or_else(|error| panic!("{error}"))
}

fn run(sweep: &mut GpuSweep, suite: Suite) {
    // It does not read the threads or their flags.
    let flags = Suite::default().flags.into_iter().take(1).collect();
    let suite = Suite { encodings: vec![Encoding::List], flags, ..suite };
    conform(sweep, &suite);
}

/// The pairs by the cores' grid, in order.
fn expected(boxes: &[Aabb]) -> Vec<[u32; 2]> {
    let mut reply = HeapReply::new();
    let input = CullInput::boxes(boxes).encoding(Encoding::List);
    let report = CpuGrid::new().cull(&input, &mut reply).expect("an answer");
    let words = &reply.words()[..2 * report.pair_count as usize];
    let mut pairs: Vec<[u32; 2]> =
        words.as_chunks().0.iter().map(|[a, b]| [*a.min(b), *a.max(b)]).collect();
    pairs.sort_unstable();
    pairs
}

fn check(sweep: &mut GpuSweep, boxes: &[Aabb], what: &str) {
    let mut pairs = sweep.pairs(boxes).unwrap_or_else(|error| panic!("{what}: {error}")).pairs;
    pairs.sort_unstable();
    assert!(pairs == expected(boxes), "{what}");
}

#[test]
fn conforms_at_every_small_and_at_odd_sizes() {
    run(&mut sweep(Checks::Off), Suite::of_tier());
}

#[test]
fn conforms_with_checked_stages() {
    run(&mut sweep(Checks::On), Suite { sizes: vec![2, 31, 33, 70, 345], ..Suite::default() });
}

#[test]
fn hard_scenes_and_those_of_the_study_have_the_pairs_of_the_cores() {
    let mut sweep = sweep(Checks::Off);
    for scene in stress_scenes::ALL {
        for n in [257, 2_049] {
            check(&mut sweep, &scene.boxes(n, 5), &format!("{scene:?}, {n} boxes"));
        }
    }
    for scene in SweepScene::ALL {
        check(&mut sweep, &scene.boxes(20_000), &format!("{scene}"));
    }
}

/// Boxes that lie in all tubes take more room than there is: fewer tubes do.
#[test]
fn boxes_across_all_tubes_are_swept_in_fewer() {
    let mut sweep = sweep(Checks::Off);
    let mut boxes = stress_scenes::named("uniform").boxes(6_000, 3);
    let divided = sweep.pairs(&boxes).expect("a sweep").plan;
    let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
    boxes.extend(vec![all; 1_500]);
    check(&mut sweep, &boxes, "boxes across all tubes");
    let tubes = sweep.pairs(&boxes).expect("a sweep").plan;
    assert!(tubes.key_bits() < divided.key_bits(), "{tubes:?} after {divided:?}");
}

#[test]
fn a_crowd_is_swept_as_far_as_threads_may_go_and_refused_beyond() {
    let mut sweep = sweep(Checks::Off);
    let one = |n| vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; n];
    check(&mut sweep, &one(2_500), "2,500 equal boxes");
    if sweep.gpu().limits().thread_rounds != u32::MAX {
        assert!(matches!(sweep.pairs(&one(100_000)), Err(SweepError::TooCrowded)));
    }
}

#[test]
fn a_pair_that_is_told_twice_is_noticed() {
    let mut sweep = sweep(Checks::Off);
    let boxes = stress_scenes::named("uniform").boxes(345, 21);
    let mut pairs = sweep.pairs(&boxes).expect("a sweep").pairs;
    pairs.extend_from_within(..1);
    pairs.sort_unstable();
    assert!(pairs != expected(&boxes));
}
