//! Every session backend gives what the oracle says, dense and sparse, whatever the scene.
#![allow(clippy::unwrap_used)]

use pairmask::{Backend, ServedBy, Session};
use pairmask_tests::conformance::{Suite, check_engine};
use pairmask_tests::daemon::TestDaemon;
use pairmask_tests::session_engine::SessionEngine;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

fn check(mut sessions: SessionEngine) {
    check_engine(&mut sessions, &Suite::default()).unwrap();
    // Larger ones on the usual path; the sizes of the issue among them.
    let large =
        Suite { sizes: vec![1000, 4096, 10_000], quadratic_limit: 1000, ..Suite::default() };
    check_engine(&mut sessions, &large).unwrap();
}

#[test]
fn through_the_daemon() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    check(SessionEngine::new(&daemon.session(), ServedBy::Daemon));
}

#[test]
fn through_the_daemon_by_choice() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    check(SessionEngine::new(&daemon.session().backend(Backend::Auto), ServedBy::Daemon));
}

#[test]
fn in_process() {
    let builder = Session::builder().backend(Backend::InProcess);
    check(SessionEngine::new(&builder, ServedBy::InProcess));
}
