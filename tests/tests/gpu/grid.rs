//! `gpu-grid` through the conformance suite, against its mirror byte by byte, and at its limits.

use std::sync::Arc;
use std::time::Duration;

use pairmask_shaders::constants::{BATCH_BOXES, WINDOW_WORDS};
use pairmask_shaders::mirror::{self, Mirrored};
use pairmask_tests::frame_memory::TestFrame;
use pairmask_tests::gpu::{self, cull, open};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{
    Awake, Checks, DEFAULT_HOLD, EngineOptions, Grid, HostImport, Upload, grid_layout,
};
use pairmaskd::scene::{Scene, SceneName};

const LISTED: [Encoding; 2] = [Encoding::Sparse, Encoding::List];

fn run(engine: &mut Grid, suite: Suite) {
    let suite = Suite { encodings: LISTED.into(), ..suite };
    conform(engine, &suite);
}

/// Compares replies to `n` objects with the mirror's, section by section.
pub(crate) fn check_mirrored(
    n: usize,
    mirrored: &Mirrored,
    what: &str,
    mut cull: impl FnMut(Encoding) -> (CullReport, HeapReply),
) {
    let (report, reply) = cull(Encoding::Sparse);
    let MaskShape::Sparse { rows, blocks, bits, order } = report.shape else {
        panic!("{what}: not sparse")
    };
    let order = order.expect("a grid has an order");
    // Not `assert_eq`, which would print thousands of numbers.
    assert!(order.of(reply.words()) == Some(&mirrored.order[..]), "{what}: order");
    for (section, slot) in [rows, blocks, bits].into_iter().zip(0..) {
        let expected: Vec<u32> = mirrored.words.iter().map(|word| word[slot]).collect();
        assert!(section.of(reply.words()) == Some(&expected[..]), "{what}: section {slot}");
    }
    let compared =
        |report: &CullReport| BoxCount::new(n as u32).pair_count() - report.skipped.pairs;
    assert_eq!(compared(&report), mirrored.compared, "{what}: tests");
    let (report, reply) = cull(Encoding::List);
    let MaskShape::List { pairs } = report.shape else { panic!("{what}: no list") };
    assert!(pairs.of(reply.words()) == Some(mirrored.pairs.as_flattened()), "{what}: pairs");
    assert_eq!(compared(&report), mirrored.compared, "{what}: tests");
}

fn check_bytes<'a>(engine: &mut Grid, boxes: impl Into<BoxSlice<'a>>, what: &str) {
    let boxes = boxes.into();
    let mirrored = mirror::frame(&grid_layout(boxes), boxes);
    check_mirrored(boxes.len(), &mirrored, what, |encoding| cull(engine, boxes, encoding));
}

#[test]
#[should_panic(expected = "one pair the other way round: pairs")]
fn the_comparator_notices_one_pair_the_other_way_round() {
    let boxes = stress_scenes::named("uniform").boxes(345, 21);
    let boxes = BoxSlice::from(&boxes);
    let mut mirrored = mirror::frame(&grid_layout(boxes), boxes);
    mirrored.pairs.last_mut().expect("some overlap").reverse();
    let mut engine = gpu::grid(&EngineOptions::default());
    let what = "one pair the other way round";
    check_mirrored(345, &mirrored, what, |encoding| cull(&mut engine, boxes, encoding));
}

#[test]
fn conforms_at_every_small_and_at_odd_sizes() {
    run(&mut gpu::grid(&EngineOptions::default()), Suite::of_tier());
}

#[test]
fn conforms_around_batch_borders() {
    let sizes = vec![255, 256, 257, 511, 513, 2047, 2049, 4096];
    let suite = Suite { sizes, quadratic_limit: 2049, seed: 3, ..Suite::default() };
    run(&mut gpu::grid(&EngineOptions::default()), suite);
}

/// Checked stages, memory that held something else, boxes in mapped video memory.
#[test]
fn conforms_in_every_form_of_its_frames() {
    let poisoned = |word| EngineOptions { poison: Some(word), ..EngineOptions::default() };
    let mapped = EngineOptions { upload: Some(Upload::MappedVideo), ..EngineOptions::default() };
    for (options, sizes) in [
        (
            EngineOptions { checks: Checks::On, ..EngineOptions::default() },
            vec![2, 31, 33, 70, 1234],
        ),
        (poisoned(0xa5a5_a5a5), (0..70).step_by(9).chain([1000]).collect()),
        (poisoned(u32::MAX), vec![33, 345]),
        (mapped, vec![33, 700]),
    ] {
        run(&mut gpu::grid(&options), Suite { sizes, ..Suite::default() });
    }
}

#[test]
fn every_scene_has_the_bytes_of_the_mirror() {
    for checks in [Checks::Off, Checks::On] {
        let mut engine = gpu::grid(&EngineOptions { checks, ..EngineOptions::default() });
        for scene in stress_scenes::ALL {
            // Frames of other sizes before leave nothing.
            for n in [1234, 2, 345, 33] {
                check_bytes(&mut engine, &scene.boxes(n, 21), &format!("{scene:?}, {n} boxes"));
            }
        }
    }
}

#[test]
fn every_form_has_the_bytes_of_the_mirror() {
    let mut engine = gpu::grid(&EngineOptions::default());
    for scene in stress_scenes::ALL {
        for n in [2, 33, 345, 1233] {
            let boxes = scene.boxes(n, 21);
            let bounds = Bounds::around(&boxes);
            for precision in [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16] {
                let memory = NarrowMemory::write(&precision, &boxes);
                let what = format!("{scene:?}, {n} boxes, {}", precision.form());
                check_bytes(&mut engine, memory.boxes(), &what);
            }
        }
    }
}

/// The oracle is too slow here; `cpu-grid` is fast enough, and tested against the oracle.
#[test]
#[ignore = "slow: the nightly tier runs it"]
fn large_scenes_have_the_pairs_of_the_cpu_grid() {
    let mut gpu = gpu::grid(&EngineOptions::default());
    let binding = gpu.gpu().limits().storage_binding_bytes;
    // More in one place is more than a software adapter gets through (`crowds`).
    let crowd = if gpu.gpu().limits().thread_rounds == u32::MAX { 6_000 } else { 3_800 };
    let mut cpu = best_engine(EngineName::CpuGrid);
    for scene in stress_scenes::ALL {
        let quadratic = scene.is_quadratic;
        for n in if quadratic { [3_000, crowd] } else { [10_000, 20_000] } {
            let boxes = scene.boxes(n, 13);
            let (expected, expected_reply) = cull(&mut *cpu, &boxes, Encoding::Sparse);
            let sorted = |report: &CullReport, reply: &HeapReply| {
                naive_decoder::decode(reply.words(), &report.shape, n).expect("a good mask")
            };
            let pairs = sorted(&expected, &expected_reply);
            for encoding in LISTED {
                if encoding == Encoding::List && 8 * pairs.len() as u64 > binding {
                    continue;
                }
                let (report, reply) = cull(&mut gpu, &boxes, encoding);
                let what = format!("{scene:?}, {n} boxes, {encoding}");
                assert_eq!(report.census, expected.census, "{what}");
                assert_eq!(report.pair_count, expected.pair_count, "{what}");
                assert!(sorted(&report, &reply) == pairs, "{what}");
            }
        }
    }
}

#[test]
fn worst_cases_are_slower_and_not_wrong() {
    let mut engine = gpu::grid(&EngineOptions::default());
    for (name, n) in
        [(SceneName::Rods, 4000), (SceneName::Giants, 4000), (SceneName::OneCell, 2500)]
    {
        let boxes = Scene::new(name, n, 4).boxes().to_vec();
        let truth = oracle::truth(&boxes);
        for encoding in LISTED {
            let (report, reply) = cull(&mut engine, &boxes, encoding);
            check_reply(reply.words(), &report, boxes.len() as u32, encoding, &truth)
                .unwrap_or_else(|mismatch| panic!("{name}, {encoding}: {mismatch}"));
        }
    }
}

#[test]
fn a_crowd_beyond_the_budget_is_refused_and_the_next_frame_is_served() {
    let mut engine = gpu::grid(&EngineOptions::default());
    let crowd = vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; 150_000];
    let mut reply = HeapReply::new();
    for encoding in LISTED {
        let refused = engine.cull(&CullInput::boxes(&crowd).encoding(encoding), &mut reply);
        assert!(matches!(refused, Err(CullError::TooCrowded { .. })), "{refused:?}");
    }
    let mut all = vec![Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] }; 40];
    all.extend(stress_scenes::named("uniform").boxes(3000, 5));
    check_bytes(&mut engine, &all, "after a crowd");
}

/// Words a row around those that a batch's window in workgroup memory holds on average, so that batches
/// of both kinds follow each other.
#[test]
fn batches_with_and_without_room_have_the_bytes_of_the_mirror() {
    let a_row = 32 * WINDOW_WORDS / BATCH_BOXES;
    for checks in [Checks::Off, Checks::On] {
        let mut engine = gpu::grid(&EngineOptions { checks, ..EngineOptions::default() });
        for neighbours in [1, a_row - 40, a_row - 32, a_row - 24, a_row, 2 * a_row] {
            for n in [255, 256, 257, 1234, 4097] {
                let boxes = chain(n, neighbours);
                let what = format!("{n} boxes of {neighbours} neighbours");
                check_bytes(&mut engine, &boxes, &what);
            }
        }
    }
}

/// Boxes along a line, each of which overlaps so many after it.
fn chain(n: u32, neighbours: u32) -> Vec<Aabb> {
    let at = |i: u32| [i as f32, 0.0, 0.0];
    (0..n).map(|i| Aabb { min: at(i), max: at(i + neighbours) }).collect()
}

/// The largest list that a device binds, and one that it does not.
#[test]
fn a_list_beyond_a_binding_is_left_to_all_pairs() {
    let mut engine = gpu::grid(&EngineOptions::default());
    let binding = engine.gpu().limits().storage_binding_bytes;
    if binding > 128 << 20 {
        // The scene would be another, and its list gigabytes.
        return;
    }
    let neighbours = 200;
    let pairs =
        |n: u32| u64::from(n) * u64::from(neighbours) - BoxCount::new(neighbours + 1).pair_count();
    let most =
        (neighbours..1 << 20).take_while(|n| 8 * pairs(*n) <= binding).last().expect("some do");
    let mut reply = HeapReply::new();
    let mut frame = |n| {
        let boxes = chain(n, neighbours);
        engine.cull(&CullInput::boxes(&boxes).encoding(Encoding::List), &mut reply)
    };
    assert!(matches!(frame(most + 1), Err(CullError::TooCrowded { .. })));
    let report = frame(most).expect("a list");
    assert_eq!(report.pair_count, pairs(most));
    assert_eq!(report.shape, MaskShape::list(report.pair_count));
}

/// Frame after frame without a pause, each with other levels: what a frame left in the device's
/// caches must not reach the next one.
#[test]
fn frames_in_a_row_with_other_levels_do_not_mix() {
    let mut engine = gpu::grid(&EngineOptions::default());
    let names = ["huge", "sizes over 20 octaves", "uniform", "ground plane", "far from the origin"];
    let scenes = names.map(|name| stress_scenes::named(name).boxes(43, 2));
    let truths = scenes.each_ref().map(|boxes| oracle::truth(boxes));
    for round in 0..50 {
        let reports: Vec<_> = scenes
            .iter()
            .zip(LISTED.iter().cycle())
            .map(|(boxes, encoding)| cull(&mut engine, boxes, *encoding).0)
            .collect();
        for ((report, truth), name) in reports.iter().zip(&truths).zip(names) {
            let counted = truth.pairs.len() as u64;
            assert_eq!(report.pair_count, counted, "{name}, round {round}");
        }
    }
}

/// The boxes of a frame are copied while the frame before it runs. This is forced here, so that a
/// device without a queue for copies does the same on its one queue.
#[test]
fn frames_behind_each_other_keep_to_their_own_boxes() {
    let upload = Some(Upload::DmaCopy);
    let mut engine = gpu::grid(&EngineOptions { upload, ..EngineOptions::default() });
    let scenes = ["uniform", "clustered", "infinite"];
    let scenes = scenes.map(|name| stress_scenes::named(name).boxes(1234, 6));
    let truths = scenes.each_ref().map(|boxes| oracle::truth(boxes));
    for round in 0..12 {
        let turns = [round % 3, (round + 1) % 3];
        let frames = turns.map(|turn| {
            let memory = TestFrame::on_heap(&Precision::Exact, &scenes[turn]);
            let frame = engine.begin(memory, LISTED[turn % 2]);
            frame.map_err(|(error, _)| error).expect("a free workspace")
        });
        for (frame, turn) in frames.into_iter().zip(turns) {
            let encoding = LISTED[turn % 2];
            let (report, memory) = engine.end(frame);
            let (report, memory) = (report.expect("a frame"), memory.expect("an ended frame"));
            let (words, truth) = (memory.reply.words(), &truths[turn]);
            let checked = check_reply(words, &report, 1234, encoding, truth);
            assert_eq!(checked, Ok(()), "round {round}");
        }
    }
}

#[test]
fn a_device_is_kept_awake_while_frames_come_and_answers_them() {
    let gpu = open(HostImport::IfPossible);
    if gpu.is_software() {
        let started = Awake::start(&gpu, DEFAULT_HOLD).expect("no fault");
        assert!(started.is_none(), "it would take the cores that frames run on");
    }
    // Longer than a busy machine takes to wake the thread.
    let awake = Awake::launch(&gpu, Duration::from_millis(500)).expect("a frame");
    let mut engine = Grid::new(&gpu, &EngineOptions::default()).expect("an engine");
    let boxes = stress_scenes::named("uniform").boxes(1234, 6);
    for _ in 0..5 {
        awake.note_frame();
        check_bytes(&mut engine, &boxes, "kept awake");
    }
    until("a dispatch ends", || awake.dispatches() > 0);
    eventually("it ends with the frames", || {
        let before = awake.dispatches();
        std::thread::sleep(Duration::from_secs(1));
        (awake.dispatches() == before).then_some(())
    });
    drop(awake);
    check_bytes(&mut engine, &boxes, "afterwards");
}

#[test]
fn a_lost_device_is_not_kept_awake_and_let_go() {
    let gpu = open(HostImport::IfPossible);
    let awake = Awake::launch(&gpu, Duration::from_secs(3600)).expect("a frame");
    awake.note_frame();
    until("a dispatch ends", || awake.dispatches() > 0);
    gpu.destroy();
    drop(awake);
    // Its thread stays, without the device.
    until("nobody else has it", || Arc::strong_count(&gpu) == 1);
}
