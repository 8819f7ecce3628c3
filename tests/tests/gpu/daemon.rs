//! The GPU behind the daemon, on a software adapter. Without an adapter the tests fail, and are
//! never skipped.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_tests::gpu::{self, begin, end, pairs_by_cpu, pairs_of};
use pairmask_tests::prelude::*;
use pairmask_tests::session_engine::SessionEngine;
use pairmask_tests::spheres::{hard_scene, truth};
use pairmaskd::execute::{Executor, Owner};

const GPU: EngineChoice = EngineChoice::Only(EngineName::GpuBrute);
const GRID: EngineChoice = EngineChoice::Only(EngineName::GpuGrid);

#[test]
fn sessions_get_what_the_oracle_says() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let mut sessions = SessionEngine::new(&daemon.session(), engine, ServedBy::Daemon);
        let sizes = (0..70).step_by(if tier::is_nightly() { 1 } else { 23 });
        let sizes = sizes.chain([33, 345, 1234]).collect();
        let encodings = engine.descriptor().encodings.to_vec();
        conform(&mut sessions, &Suite { sizes, encodings, ..Suite::default() });
    }
}

#[test]
fn a_dense_mask_of_the_grid_comes_from_all_pairs() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let dense = EncodingChoice::Only(Encoding::Dense);
    let mut session = daemon.session().engine(GRID).encoding(dense).connect().unwrap();
    let boxes = stress_scenes::named("uniform").boxes(700, 3);
    let mask = session.answer(&boxes);
    assert_eq!(mask.info().engine, EngineName::GpuBrute);
    assert_eq!(mask.count(), oracle::truth(&boxes).pairs.len() as u64);
}

/// Frames large enough to be left under way: two clients with two each, in any order and form, of which
/// one asks for lists.
#[test]
fn frames_under_way_at_a_time_do_not_mix() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let n = 33_001;
    let encodings = [Encoding::Sparse, Encoding::List];
    let mut sessions: [Session; 2] = encodings.map(|encoding| {
        let encoding = EncodingChoice::Only(encoding);
        daemon.session().engine(GRID).encoding(encoding).connect().unwrap()
    });
    let scenes: Vec<_> =
        (0..4).map(|seed| stress_scenes::named("uniform").boxes(n, seed)).collect();
    let [q16, q8, f16] = narrow_precisions(&scenes[0]);
    for precisions in [[Precision::Exact; 4], [q8, Precision::Exact, f16, q16]] {
        let mut pending = Vec::new();
        for ((boxes, precision), turn) in scenes.iter().zip(precisions).zip([0, 0, 1, 1]) {
            pending.push(sessions[turn].ask_narrow(boxes, precision));
        }
        for ((boxes, precision), frame) in scenes.iter().zip(precisions).zip(pending) {
            let mask = frame.wait().unwrap();
            let info = mask.info();
            assert_eq!(info.engine, EngineName::GpuGrid);
            assert_eq!(info.form, precision.form().into());
            let pairs = mask.sorted();
            let expected = pairs_by_cpu(boxes, &precision);
            assert!(pairs == expected, "{} and {} pairs", pairs.len(), expected.len());
        }
    }
}

#[test]
fn clients_come_and_go_and_grow() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let scene = stress_scenes::named("uniform");
    // A client's segment is often mapped at the address of the last client's: an import must not
    // outlive its segment.
    for client in 0..6u64 {
        let capacity = BoxCount::new(64);
        let mut session = daemon.session().engine(GPU).capacity(capacity).connect().unwrap();
        for (frame, n) in [50, 60, 700, 1500, 30, 1500].into_iter().enumerate() {
            let boxes = scene.boxes(n, 10 * client + frame as u64);
            let mask = session.answer(&boxes);
            assert_eq!(mask.info().engine, EngineName::GpuBrute);
            assert_eq!(mask.sorted(), oracle::truth(&boxes).pairs, "client {client}, {n} boxes");
        }
    }
}

/// The GPU writes masks where their clients read them: it lets go of that memory before it is given back.
#[test]
fn memory_that_a_gpu_wrote_masks_to_is_given_back() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let dense = EncodingChoice::Only(Encoding::Dense);
    let boxes = stress_scenes::named("uniform").boxes(5000, 3);
    let expected = oracle::truth(&boxes).pairs;
    let before = daemon.shared_bytes();
    for _ in 0..3 {
        let mut session = daemon.session().engine(GPU).encoding(dense).connect().unwrap();
        // From the second frame on the mask is written where it lies.
        for _ in 0..4 {
            let mask = session.answer(&boxes);
            assert_eq!(mask.info().engine, EngineName::GpuBrute);
            assert_eq!(mask.to_vec(), expected);
        }
        assert!(daemon.shared_bytes() > before + 1_500_000);
        drop(session);
        until("the memory of masks comes back", || daemon.shared_bytes() < before + (256 << 10));
    }
}

fn narrow_precisions(boxes: &[Aabb]) -> [Precision; 3] {
    let bounds = Bounds::around(boxes);
    [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16]
}

/// A list of more bytes than one binding of the device shows.
#[test]
fn a_list_beyond_the_device_comes_from_the_cpu() {
    let mut executor = gpu::executor(1);
    let boxes = vec![Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 6_000];
    let pairs = 6_000 * 5_999 / 2;
    let device = executor.device().unwrap();
    assert!(device.limits().storage_binding_bytes < 8 * pairs, "or the test shows nothing");
    let mut reply = HeapReply::new();
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let (boxes, options) = (BoxSlice::from(&boxes), culled(engine, Encoding::List));
        let answer = executor.cull(boxes, Owner::Daemon, &options, &mut reply).unwrap();
        assert!(!answer.engine.is_gpu(), "{}", answer.engine);
        assert_eq!(answer.report.pair_count, pairs);
        assert_eq!(answer.report.shape, MaskShape::list(pairs));
    }
}

#[test]
fn a_frame_outlives_its_executor() {
    let mut executor = gpu::executor(1);
    let boxes = stress_scenes::named("uniform").boxes(33_001, 3);
    let exact = Precision::Exact;
    let [first, second] = [0, 1].map(|owner| begin(&mut executor, owner, &boxes, &exact));
    drop(executor);
    drop(first.0);
    assert_eq!((Arc::strong_count(&first.2), Arc::strong_count(&second.2)), (1, 2));
    // It has kept the GPU, which no other engines of this process know.
    let (answer, words) = end(&mut Executor::new(None), second.0);
    assert_eq!(answer.engine, EngineName::GpuGrid);
    assert!(pairs_of(33_001, &answer, &words) == pairs_by_cpu(&boxes, &exact));
    assert_eq!(Arc::strong_count(&second.2), 1);
}

#[test]
fn narrow_frames_are_left_under_way_and_outlive_their_device() {
    let mut executor = gpu::executor(1);
    let n = 33_001;
    let boxes = stress_scenes::named("uniform").boxes(n, 3);
    let [q16, q8, f16] = narrow_precisions(&boxes);
    for (pair, is_lost) in [([q16, q8], false), ([q8, f16], false), ([f16, q16], true)] {
        let begun = [0, 1].map(|turn| begin(&mut executor, turn as u64, &boxes, &pair[turn]).0);
        if is_lost {
            executor.device().expect("the device is there").destroy();
        }
        for (frame, precision) in begun.into_iter().zip(pair) {
            let (answer, words) = end(&mut executor, frame);
            assert!(is_lost || answer.engine == EngineName::GpuGrid, "{}", answer.engine);
            let ours = pairs_of(n as usize, &answer, &words);
            // Not `assert_eq`, which would print thousands of pairs.
            let are_right = ours == pairs_by_cpu(&boxes, &precision);
            assert!(are_right, "{precision:?}, by {}", answer.engine);
        }
    }
    // Now the CPU serves, or the device that was opened again.
    let memory = NarrowMemory::write(&q8, &boxes);
    let (mut reply, options) = (HeapReply::new(), culled_by(EngineName::GpuGrid));
    let answer = executor.cull(memory.boxes(), Owner::Client(0), &options, &mut reply).unwrap();
    let ours = pairs_of(n as usize, &answer, reply.words());
    assert!(ours == pairs_by_cpu(&boxes, &q8), "by {}", answer.engine);
}

#[test]
fn a_device_destroyed_under_load_costs_no_answer_and_comes_back() {
    let mut executor = gpu::executor(1);
    let boxes = stress_scenes::named("uniform").boxes(1234, 3);
    let expected = oracle::truth(&boxes).pairs;
    let mut reply = HeapReply::new();
    // As many as a software adapter decides.
    let spheres = hard_scene(16, 8);
    let spheres_expected = truth(&spheres);
    let mut cull = |executor: &mut Executor, encoding| {
        let (slice, options) = (BoxSlice::from(&boxes), culled(EngineName::GpuBrute, encoding));
        let answer = executor.cull(slice, Owner::Client(1), &options, &mut reply).unwrap();
        let pairs = pairs_of(boxes.len(), &answer, reply.words());
        assert_eq!(pairs, expected, "by {}", answer.engine);
        let of_spheres = executor.cull_spheres(&spheres, Owner::Client(1), &options, &mut reply);
        let of_spheres = of_spheres.unwrap();
        let (words, report) = (reply.words(), &of_spheres.report);
        assert_eq!(check_reply(words, report, 16, encoding, &spheres_expected), Ok(()));
        [answer.engine, of_spheres.engine]
    };
    let both = [EngineName::GpuBrute; 2];
    assert_eq!(cull(&mut executor, Encoding::Dense), both);
    for round in 0..3 {
        let device = executor.device().expect("the device is there");
        let killer = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20 + 7 * round));
            device.destroy();
        });
        while !killer.is_finished() {
            cull(&mut executor, Encoding::Sparse);
        }
        killer.join().unwrap();
        let lost_at = Instant::now();
        let mut engines = Vec::new();
        while engines.last() != Some(&both) || engines.len() < 2 {
            engines.push(cull(&mut executor, Encoding::Sparse));
            assert!(lost_at.elapsed() < TIMEOUT, "the GPU comes back");
        }
    }
}
