//! The GPU behind the daemon, on a software adapter. Fails, never skips, where there is none.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask::engine::{CullJob, CullWish, Engine, EngineChoice, EngineName, HeapReply};
use pairmask::mask::{EncodingChoice, MaskView};
use pairmask::precision::NarrowBoxes;
use pairmask::{Bounds, BoxCount, Encoding, Precision, ServedBy, Session};
use pairmask_tests::conformance::{Suite, check_engine};
use pairmask_tests::daemon::{PATIENCE, TestDaemon};
use pairmask_tests::session_engine::SessionEngine;
use pairmask_tests::{naive_modes, oracle, stress_scenes};
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::execute::{Executor, GpuService, Owner};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const GPU: EngineChoice = EngineChoice::Only(EngineName::GpuBrute);

#[test]
fn sessions_get_what_the_oracle_says() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let mut sessions =
        SessionEngine::new(&daemon.session(), EngineName::GpuBrute, ServedBy::Daemon);
    check_engine(&mut sessions, &Suite::default()).unwrap();
}

#[test]
fn sessions_get_what_the_oracle_says_from_the_grid() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let mut sessions = SessionEngine::new(&daemon.session(), EngineName::GpuGrid, ServedBy::Daemon);
    let sizes = (0..70).step_by(7).chain([345, 1234]).collect();
    let suite = Suite { sizes, encodings: vec![Encoding::Sparse], ..Suite::default() };
    check_engine(&mut sessions, &suite).unwrap();
}

#[test]
fn a_dense_mask_of_the_grid_comes_from_all_pairs() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let grid = EngineChoice::Only(EngineName::GpuGrid);
    let dense = EncodingChoice::Only(Encoding::Dense);
    let mut session = daemon.session().engine(grid).encoding(dense).connect().unwrap();
    let boxes = stress_scenes::named("uniform").boxes(700, 3);
    let mut shared = session.frame(boxes.len()).unwrap();
    shared.boxes_mut().copy_from_slice(&boxes);
    let mask = shared.submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().engine, EngineName::GpuBrute);
    assert_eq!(mask.count(), oracle::truth(&boxes).pairs.len() as u64);
}

/// Frames large enough to be left under way: two clients with two each, in any order.
#[test]
fn frames_under_way_at_a_time_do_not_mix() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let grid = EngineChoice::Only(EngineName::GpuGrid);
    let n = 33_000;
    let mut sessions: Vec<Session> =
        (0..2).map(|_| daemon.session().engine(grid).connect().unwrap()).collect();
    let scenes: Vec<_> =
        (0..4).map(|seed| stress_scenes::named("uniform").boxes(n, seed)).collect();
    let mut pending = Vec::new();
    for (boxes, turn) in scenes.iter().zip([0, 0, 1, 1]) {
        let mut shared = sessions[turn].frame(boxes.len()).unwrap();
        shared.boxes_mut().copy_from_slice(boxes);
        pending.push(shared.submit().unwrap());
    }
    let mut cpu = pairmask::engine::Grid::new();
    for (boxes, frame) in scenes.iter().zip(pending) {
        let mask = frame.wait().unwrap();
        assert_eq!(mask.info().engine, EngineName::GpuGrid);
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        let mut reply = HeapReply::new();
        let job = CullJob { encoding: Encoding::Sparse, threads: 1 };
        let report = cpu.cull(boxes, &job, &mut reply).unwrap();
        let view = MaskView::new(BoxCount::new(n), &report.shape, reply.words()).unwrap();
        let mut expected = view.to_vec();
        expected.sort_unstable();
        assert!(pairs == expected, "{} and {} pairs", pairs.len(), expected.len());
    }
}

#[test]
fn clients_come_and_go_and_grow() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let scene = stress_scenes::named("uniform");
    // A client's segment is often mapped where the last one's was: an import must not outlive it.
    for client in 0..6u64 {
        let capacity = BoxCount::new(64);
        let mut session = daemon.session().engine(GPU).capacity(capacity).connect().unwrap();
        for (frame, n) in [50, 60, 700, 1500, 30, 1500].into_iter().enumerate() {
            let boxes = scene.boxes(n, 10 * client + frame as u64);
            let mut shared = session.frame(boxes.len()).unwrap();
            shared.boxes_mut().copy_from_slice(&boxes);
            let mask = shared.submit().unwrap().wait().unwrap();
            assert_eq!(mask.info().engine, EngineName::GpuBrute);
            let mut pairs = mask.to_vec();
            pairs.sort_unstable();
            assert_eq!(pairs, oracle::truth(&boxes).pairs, "client {client}, {n} boxes");
        }
    }
}

#[test]
fn a_daemon_without_a_gpu_says_so() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut session: Session = daemon.session().engine(GPU).connect().unwrap();
    let error = session.frame(3).unwrap().submit().unwrap().wait().unwrap_err();
    assert!(error.to_string().contains("engine-unavailable"), "{error}");
}

/// They are expanded into memory that grows and moves from frame to frame: a GPU that kept an
/// import of it would read what is not there any more.
#[test]
fn narrow_boxes_are_culled_on_the_gpu() {
    let gpu = GpuService::open(&GpuChoice::Software, Duration::ZERO)
        .expect("a software adapter (lavapipe)");
    let mut executor = Executor::new(Some(gpu));
    let mut reply = HeapReply::new();
    for n in [70, 1234, 345, 3000, 2] {
        let boxes = stress_scenes::named("uniform").boxes(n, 3);
        let bounds = Bounds::around(&boxes);
        for precision in [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16] {
            let form = precision.form();
            let bytes = boxes.len() * form.box_bytes();
            let mut words = vec![0u32; bytes.div_ceil(4)];
            let memory = &mut bytemuck::cast_slice_mut(&mut words)[..bytes];
            precision.write(&boxes, memory);
            let narrow = NarrowBoxes::new(form, memory).unwrap();
            let wish = CullWish { engine: GPU, ..CullWish::default() };
            let answer = executor.cull(narrow, Owner::Client(1), &wish, &mut reply).unwrap();
            assert_eq!(answer.engine, EngineName::GpuBrute);
            let count = BoxCount::new(n);
            let view = MaskView::new(count, &answer.report.shape, reply.words()).unwrap();
            let mut pairs = view.to_vec();
            pairs.sort_unstable();
            assert_eq!(pairs, naive_modes::truth(&boxes, &precision).pairs, "{n} boxes, {form}");
        }
    }
}

#[test]
fn a_device_destroyed_under_load_costs_no_answer_and_comes_back() {
    let gpu = GpuService::open(&GpuChoice::Software, Duration::ZERO)
        .expect("a software adapter (lavapipe)");
    let mut executor = Executor::new(Some(gpu));
    let boxes = stress_scenes::named("uniform").boxes(1234, 3);
    let expected = oracle::truth(&boxes).pairs;
    let mut reply = HeapReply::new();
    let mut cull = |executor: &mut Executor, encoding| {
        let wish = CullWish {
            engine: GPU,
            encoding: EncodingChoice::Only(encoding),
            ..CullWish::default()
        };
        let answer =
            executor.cull(NarrowBoxes::F32(&boxes), Owner::Client(1), &wish, &mut reply).unwrap();
        let n = BoxCount::new(boxes.len() as u32);
        let mut pairs = MaskView::new(n, &answer.report.shape, reply.words()).unwrap().to_vec();
        pairs.sort_unstable();
        assert_eq!(pairs, expected, "by {}", answer.engine);
        answer.engine
    };
    assert_eq!(cull(&mut executor, Encoding::Dense), EngineName::GpuBrute);
    for round in 0..3 {
        let device = executor.gpu().unwrap().device().expect("the device is there");
        let stop = Arc::new(AtomicBool::new(false));
        let killer = std::thread::spawn({
            let stop = Arc::clone(&stop);
            move || {
                std::thread::sleep(Duration::from_millis(20 + 7 * round));
                device.destroy();
                stop.store(true, Ordering::Relaxed);
            }
        });
        while !stop.load(Ordering::Relaxed) {
            cull(&mut executor, Encoding::Sparse);
        }
        killer.join().unwrap();
        let lost_at = Instant::now();
        let mut engines = Vec::new();
        while engines.last() != Some(&EngineName::GpuBrute) || engines.len() < 2 {
            engines.push(cull(&mut executor, Encoding::Sparse));
            assert!(lost_at.elapsed() < PATIENCE, "the GPU comes back");
        }
    }
}
