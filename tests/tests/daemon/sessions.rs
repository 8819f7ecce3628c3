//! Every session backend has the oracle's answers: every engine, encoding and scene.

use std::time::Duration;

use pairmask::{CenterHalf, Frame, Quantized};
use pairmask_tests::conformance::check_engine;
use pairmask_tests::frames;
use pairmask_tests::prelude::*;
use pairmask_tests::session_engine::SessionEngine;
use rayon::iter::ParallelIterator;

fn check(builder: &SessionBuilder, engine: EngineName, expected: ServedBy) {
    let mut sessions = SessionEngine::new(builder, engine, expected);
    check_engine(&mut sessions, &Suite::default()).unwrap();
    let large =
        Suite { sizes: vec![1000, 4096, 10_000], quadratic_limit: 1000, ..Suite::default() };
    check_engine(&mut sessions, &large).unwrap();
}

#[test]
fn through_the_daemon() {
    let daemon = TestDaemon::start(&[]);
    for engine in EngineName::CPU {
        check(&daemon.session(), engine, ServedBy::Daemon);
    }
    let by_choice = daemon.session().backend(Backend::Auto);
    check(&by_choice, EngineName::CpuBrute, ServedBy::Daemon);
}

#[test]
fn in_process() {
    for engine in EngineName::CPU {
        check(&Session::builder().backend(Backend::InProcess), engine, ServedBy::InProcess);
    }
}

#[test]
fn a_daemon_is_waited_for_without_end() {
    let daemon = TestDaemon::start(&[]);
    let builder = daemon.session().backend(Backend::Daemon);
    let mut session = builder.deadline(Duration::MAX).spin(Duration::MAX).connect().unwrap();
    let boxes = stress_scenes::named("uniform").boxes(300, 2);
    let expected = oracle::truth(&boxes).pairs.len() as u64;
    for has_timeout in [false, true] {
        let mut pending = session.ask(&boxes);
        let mask = if has_timeout { pending.wait_timeout(Duration::MAX) } else { pending.wait() };
        assert_eq!(mask.unwrap().count(), expected);
    }
}

#[test]
fn a_frame_is_taken_once_in_whichever_way() {
    let daemon = TestDaemon::start(&[]);
    let boxes = stress_scenes::named("uniform").boxes(300, 2);
    let expected = oracle::truth(&boxes).pairs;
    for backend in [Backend::Daemon, Backend::InProcess] {
        let mut session = daemon.session().backend(backend).connect().unwrap();
        let mut submit = || {
            let mut frame = session.frame(boxes.len()).unwrap();
            frame.boxes_mut().copy_from_slice(&boxes);
            frame.submit().unwrap()
        };
        let (mut first, mut second) = (submit(), submit());
        // The second is under way before the first is taken, and may be taken before it.
        let waited = second.wait_timeout(TIMEOUT).unwrap();
        let tried = eventually("the first frame is there", || first.try_receive().unwrap());
        for mask in [&waited, &tried] {
            assert_eq!(mask.sorted(), expected);
            assert_eq!(mask.count(), expected.len() as u64);
            let bits: u64 = mask.words().map(|word| u64::from(word.bits.count())).sum();
            assert_eq!(bits, mask.count());
            let [a, b] = expected[0];
            assert!(mask.contains(a, b) && mask.contains(b, a) && !mask.contains(a, a));
            assert_eq!(mask.par_pairs().count() as u64, mask.count());
        }
        assert!(matches!(first.try_receive(), Err(Error::AlreadyReceived)));
        assert!(matches!(second.wait(), Err(Error::AlreadyReceived)));
    }
}

#[test]
fn a_frame_from_arrays_of_any_layout_holds_their_boxes() {
    let daemon = TestDaemon::start(&[]);
    // The last is written past the caches.
    for n in [0, 1, 33, 1235, 400_001] {
        let center: Vec<_> =
            (0..n).map(|i| [1, 3, 7].map(|k| (i * k % 1009) as f32 * 0.71)).collect();
        let half: Vec<_> = (0..n).map(|i| [(i % 5) as f32 * 0.17, 0.5, 0.3]).collect();
        let boxes: Vec<_> =
            center.iter().zip(&half).map(|(c, h)| Aabb::from_center_half(*c, *h)).collect();
        let columns = |points: &[[f32; 3]]| {
            [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>())
        };
        let (center_columns, half_columns) = (columns(&center), columns(&half));
        for backend in [Backend::Daemon, Backend::InProcess] {
            let mut session = daemon.session().backend(backend).connect().unwrap();
            let mut written = |write: &dyn Fn(&mut Frame)| {
                let mut frame = session.frame(n).unwrap();
                assert_eq!(frame.is_shared(), backend == Backend::Daemon);
                frame.boxes_mut().fill(Aabb::EMPTY);
                write(&mut frame);
                assert!(frame.boxes() == boxes, "{n} boxes, {backend:?}");
                if n < 2000 {
                    let mask = frame.submit().unwrap().wait().unwrap();
                    assert_eq!(mask.sorted(), oracle::truth(&boxes).pairs);
                }
            };
            written(&|frame| frame.write(&boxes).unwrap());
            written(&|frame| frame.write(boxes.as_slice()).unwrap());
            written(&|frame| frame.write(&CenterHalf::points(&center, &half)).unwrap());
            written(&|frame| {
                let [center, half] = [&center_columns, &half_columns]
                    .map(|columns| columns.each_ref().map(Vec::as_slice));
                frame.write(&CenterHalf::columns(center, half)).unwrap();
            });
        }
    }
}

#[test]
fn narrow_frames_take_what_exact_ones_take() {
    let mut session = frames::in_process();
    let center: Vec<_> = (0..345).map(|i| [i as f32, (i % 9) as f32, 0.0]).collect();
    let half = vec![[0.6f32, 0.8, 1.0]; 345];
    let boxes: Vec<_> = center.iter().map(|c| Aabb::from_center_half(*c, half[0])).collect();
    for precision in [Precision::Exact, Precision::F16, Precision::Q8(Bounds::around(&boxes))] {
        let mut pairs = |fill: &dyn Fn(&mut Frame<Quantized>)| {
            let mut frame = session.narrow_frame(345, precision).unwrap();
            fill(&mut frame);
            frame.submit().unwrap().wait().unwrap().to_vec()
        };
        let expected = pairs(&|frame| frame.write(&boxes).unwrap());
        assert!(expected.len() > 300, "most neighbours overlap");
        let same = pairs(&|frame| frame.write(&CenterHalf::points(&center, &half)).unwrap());
        assert_eq!(same, expected);
    }
}

#[test]
fn too_few_boxes_are_an_error() {
    let mut session = frames::in_process();
    let mut frame = session.frame(3).unwrap();
    frame.boxes_mut().fill(Aabb::new([0.0; 3], [1.0; 3]));
    let refused = frame.write(&[Aabb::EMPTY; 2]);
    assert!(matches!(refused, Err(Error::WrongCount { given: 2, n: 3 })));
    assert_eq!(frame.submit().unwrap().wait().unwrap().count(), 3, "nothing was written");
}

#[test]
fn the_pairs_are_the_same_for_each_choice_of_the_plan() {
    let daemon = TestDaemon::start(&[]);
    let mut sessions = [daemon.connect(), frames::in_process()];
    for scene in stress_scenes::ALL {
        for n in [0, 1, 2, 33, 1234, 3000] {
            let boxes = scene.boxes(n, 9);
            let expected = oracle::truth(&boxes).pairs;
            for session in &mut sessions {
                assert_eq!(session.answer(&boxes).sorted(), expected, "{scene:?}, {n} boxes");
            }
        }
    }
}
