//! Every session backend gives what the oracle says: every engine, dense and sparse, every scene.
#![allow(clippy::unwrap_used)]

use pairmask::engine::EngineName;
use pairmask::session::SessionBuilder;
use pairmask::{Backend, ServedBy, Session};
use pairmask_tests::conformance::{Suite, check_engine};
use pairmask_tests::daemon::TestDaemon;
use pairmask_tests::session_engine::SessionEngine;
use pairmask_tests::{oracle, stress_scenes};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

fn check(builder: &SessionBuilder, engine: EngineName, expected: ServedBy) {
    let mut sessions = SessionEngine::new(builder, engine, expected);
    check_engine(&mut sessions, &Suite::default()).unwrap();
    let large =
        Suite { sizes: vec![1000, 4096, 10_000], quadratic_limit: 1000, ..Suite::default() };
    check_engine(&mut sessions, &large).unwrap();
}

const CPU_ENGINES: [EngineName; 3] =
    [EngineName::CpuBrute, EngineName::CpuSap, EngineName::CpuGrid];

#[test]
fn through_the_daemon() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    for engine in CPU_ENGINES {
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
    for engine in CPU_ENGINES {
        check(&Session::builder().backend(Backend::InProcess), engine, ServedBy::InProcess);
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
