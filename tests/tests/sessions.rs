//! Every session backend has the oracle's answers: every engine, encoding and scene.
#![allow(clippy::unwrap_used)]

use pairmask::{Backend, ServedBy, Session, SessionBuilder, WaitError};
use pairmask_core::engine::EngineName;
use pairmask_tests::conformance::{Suite, check_engine};
use pairmask_tests::daemon::{PATIENCE, TestDaemon, eventually};
use pairmask_tests::session_engine::SessionEngine;
use pairmask_tests::{oracle, stress_scenes};
use rayon::iter::ParallelIterator;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

fn check(builder: &SessionBuilder, engine: EngineName, expected: ServedBy) {
    let mut sessions = SessionEngine::new(builder, engine, expected);
    check_engine(&mut sessions, &Suite::default()).unwrap();
    let large =
        Suite { sizes: vec![1000, 4096, 10_000], quadratic_limit: 1000, ..Suite::default() };
    check_engine(&mut sessions, &large).unwrap();
}

#[test]
fn through_the_daemon() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    for engine in EngineName::CPU {
        check(&daemon.session(), engine, ServedBy::Daemon);
    }
}

#[test]
fn through_the_daemon_by_choice() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let builder = daemon.session().backend(Backend::Auto);
    check(&builder, EngineName::CpuBrute, ServedBy::Daemon);
}

#[test]
fn in_process() {
    for engine in EngineName::CPU {
        check(&Session::builder().backend(Backend::InProcess), engine, ServedBy::InProcess);
    }
}

#[test]
fn a_frame_is_taken_once_in_whichever_way() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let boxes = stress_scenes::named("uniform").boxes(300, 2);
    let expected = oracle::truth(&boxes).pairs;
    for backend in [Backend::Daemon, Backend::InProcess] {
        let mut session = daemon.session().backend(backend).connect().unwrap();
        let mut submit = || {
            let mut frame = session.frame(boxes.len()).unwrap();
            for (slot, b) in frame.raw_mut().iter_mut().zip(&boxes) {
                *slot = (*b).into();
            }
            frame.submit().unwrap()
        };
        let (mut first, mut second) = (submit(), submit());
        // The second is under way before the first is taken, and may be taken before it.
        let waited = second.wait_timeout(PATIENCE).unwrap();
        let tried = eventually("the first frame is there", || first.try_take().unwrap());
        for mask in [&waited, &tried] {
            let mut pairs = mask.to_vec();
            pairs.sort_unstable();
            assert_eq!(pairs, expected);
            assert_eq!(mask.count(), expected.len() as u64);
            let bits: u64 = mask.words().map(|word| u64::from(word.bits.count())).sum();
            assert_eq!(bits, mask.count());
            let (a, b) = expected[0];
            assert!(mask.contains(a, b) && mask.contains(b, a) && !mask.contains(a, a));
            assert_eq!(mask.par_pairs().count() as u64, mask.count());
        }
        assert!(matches!(first.try_take(), Err(WaitError::Taken)));
        assert!(matches!(second.wait(), Err(WaitError::Taken)));
    }
}

#[test]
fn whatever_the_plan_chooses_the_pairs_are_the_same() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let mut sessions = [
        daemon.session().connect().unwrap(),
        Session::builder().backend(Backend::InProcess).connect().unwrap(),
    ];
    for scene in stress_scenes::ALL {
        for n in [0, 1, 2, 33, 1234, 3000] {
            let boxes = scene.boxes(n, 9);
            let expected = oracle::truth(&boxes).pairs;
            for session in &mut sessions {
                let mut frame = session.frame(boxes.len()).unwrap();
                frame.boxes_mut().copy_from_slice(&boxes);
                let mut pairs = frame.submit().unwrap().wait().unwrap().to_vec();
                pairs.sort_unstable();
                assert_eq!(pairs, expected, "{scene:?}, {n} boxes");
            }
        }
    }
}
