//! Daemons that are alive and cannot serve: every lane hangs, the worker hangs before it serves, or no file
//! can be opened any more.

use std::time::{Duration, Instant};

use pairmask::{Backend, ServedBy, Session};
use pairmask_core::Aabb;
use pairmask_tests::daemon::{PATIENCE, TestDaemon, eventually};
use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const HANGING: &str = env!("CARGO_BIN_EXE_pairmaskd_hanging");

const UNIT: Aabb = Aabb { min: [0.0; 3], max: [1.0; 3] };

/// Submits a pair of equal boxes, or two empty ones.
fn frame(session: &mut Session, boxes: Aabb) -> Result<(usize, ServedBy), String> {
    let mut frame = session.frame(2).map_err(|error| error.to_string())?;
    frame.boxes_mut().fill(boxes);
    let pending = frame.submit().map_err(|error| error.to_string())?;
    let mask = pending.wait().map_err(|error| error.to_string())?;
    Ok((mask.to_vec().len(), mask.info().served_by))
}

#[test]
fn a_worker_whose_lanes_all_hang_is_replaced() {
    let daemon = TestDaemon::start(HANGING, &["--gpu", "none"]);
    let before = daemon.worker();
    let is_there = || {
        daemon
            .record()
            .is_some_and(|record| record.worker_pid as i32 == before.as_raw_nonzero().get())
    };
    let start = Instant::now();
    // More than there are lanes. A client that leaves early may leave a lane free.
    let clients = std::thread::available_parallelism().unwrap().get() + 2;
    std::thread::scope(|scope| {
        for _ in 0..clients {
            scope.spawn(|| {
                while is_there() && start.elapsed() < 2 * PATIENCE {
                    let auto = daemon.session().backend(Backend::Auto);
                    let mut session = auto.deadline(Duration::from_secs(1)).connect().unwrap();
                    let sent = Instant::now();
                    assert_eq!(frame(&mut session, UNIT).unwrap(), (1, ServedBy::InProcess));
                    assert!(sent.elapsed() < Duration::from_secs(2), "{:?}", sent.elapsed());
                }
            });
        }
    });
    assert_ne!(daemon.worker(), before);
    let mut session = daemon.session().connect().unwrap();
    assert_eq!(frame(&mut session, Aabb::EMPTY).unwrap(), (0, ServedBy::Daemon));
}

#[test]
fn a_worker_that_hangs_before_it_serves_is_replaced() {
    let mut daemon = TestDaemon::start(HANGING, &["--gpu", "none"]);
    daemon.kill();
    std::fs::write(daemon.path().join("hang"), "").unwrap();
    daemon.restart();
    eventually("a worker hangs", || (!daemon.path().join("hang").exists()).then_some(()));
    let mut session = eventually("another serves", || daemon.session().connect().ok());
    assert_eq!(frame(&mut session, Aabb::EMPTY).unwrap(), (0, ServedBy::Daemon));
}

fn limit_files(process: Pid, files: Option<u64>) {
    let own = getrlimit(Resource::Nofile);
    prlimit(Some(process), Resource::Nofile, Rlimit { current: files.or(own.current), ..own })
        .unwrap();
}

#[test]
fn a_daemon_without_files_to_open_keeps_nobody_waiting_and_recovers() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut first = daemon.session().connect().unwrap();
    assert_eq!(frame(&mut first, UNIT).unwrap(), (1, ServedBy::Daemon));
    let worker = daemon.worker();
    let open = std::fs::read_dir(format!("/proc/{}/fd", worker.as_raw_nonzero())).unwrap().count();
    let (auto, insisting) = (daemon.session().backend(Backend::Auto), daemon.session());
    let mut returning = None;
    // A client needs eight files: connecting ends early, half way and late.
    for spare in 0..8 {
        limit_files(worker, Some(open as u64 + spare));
        let start = Instant::now();
        let mut session = auto.clone().connect().unwrap();
        assert_eq!(frame(&mut session, UNIT).unwrap(), (1, ServedBy::InProcess), "{spare}");
        returning = Some(session);
        let mut session = insisting.clone().connect().unwrap();
        let refused = frame(&mut session, UNIT).unwrap_err();
        assert!(refused.contains("RLIMIT_NOFILE"), "{spare}: {refused}");
        assert_eq!(frame(&mut first, UNIT).unwrap(), (1, ServedBy::Daemon), "{spare}");
        assert!(start.elapsed() < Duration::from_secs(2), "{spare}: {:?}", start.elapsed());
    }
    limit_files(worker, None);
    for mut session in [returning.unwrap(), auto.connect().unwrap()] {
        eventually("the daemon serves it", || {
            (frame(&mut session, UNIT).unwrap() == (1, ServedBy::Daemon)).then_some(())
        });
    }
    assert_eq!(daemon.worker(), worker);
}
