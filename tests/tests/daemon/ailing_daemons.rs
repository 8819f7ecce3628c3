//! Daemons that are alive and cannot serve: every lane hangs, the worker hangs before it serves, it fails its
//! supervisor's frames, or no file can be opened any more.

use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask_tests::daemon::program;
use pairmask_tests::prelude::*;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketType, bind, listen, socket};
use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};

const UNIT: Aabb = Aabb { min: [0.0; 3], max: [1.0; 3] };

/// Submits a pair of equal boxes, or two empty ones.
fn frame(session: &mut Session, boxes: Aabb) -> Result<(usize, ServedBy), String> {
    let mut submit = || {
        let mut frame = session.frame(2)?;
        frame.boxes_mut().fill(boxes);
        frame.submit()?.wait()
    };
    let mask = submit().map_err(|error: Error| error.to_string())?;
    Ok((mask.to_vec().len(), mask.info().served_by))
}

fn hanging() -> TestDaemon {
    TestDaemon::start_binary(program("pairmaskd_hanging"), &["--gpu", "none"])
}

#[test]
fn a_worker_whose_threads_all_hang_is_replaced() {
    let daemon = hanging();
    let before = daemon.worker();
    let pid = before.as_raw_nonzero().get() as u32;
    let is_there = || daemon.record().is_some_and(|record| record.worker_pid == pid);
    let start = Instant::now();
    // More than there are lanes. A client that leaves early may leave a lane free.
    let clients = std::thread::available_parallelism().unwrap().get() + 2;
    std::thread::scope(|scope| {
        for _ in 0..clients {
            scope.spawn(|| {
                while is_there() && start.elapsed() < 2 * TIMEOUT {
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
    let mut session = daemon.connect();
    assert_eq!(frame(&mut session, Aabb::EMPTY).unwrap(), (0, ServedBy::Daemon));
}

#[test]
fn a_worker_that_hangs_before_it_serves_is_replaced() {
    let mut daemon = hanging();
    daemon.kill();
    std::fs::write(daemon.path().join("hang"), "").unwrap();
    daemon.restart();
    until("a worker hangs", || !daemon.path().join("hang").exists());
    let mut session = eventually("another serves", || daemon.session().connect().ok());
    assert_eq!(frame(&mut session, Aabb::EMPTY).unwrap(), (0, ServedBy::Daemon));
}

/// How often a supervisor sends a frame in these tests, ms.
const PROBE: [&str; 4] = ["--gpu", "none", "--probe-ms", "250"];

/// Waits until another worker serves, which is as it should be.
fn is_replaced(daemon: &TestDaemon, before: Pid) {
    until("another worker serves", || daemon.worker() != before);
    let mut session = eventually("a client is let in", || daemon.session().connect().ok());
    assert_eq!(frame(&mut session, UNIT).unwrap(), (1, ServedBy::Daemon));
    let after = daemon.worker();
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(daemon.worker(), after, "one that is fit stays");
}

#[test]
fn a_worker_that_answers_wrongly_is_replaced() {
    let mut daemon = TestDaemon::idle(program("pairmaskd_hanging"), &PROBE);
    for file in ["wrong", "fit"] {
        fs::write(daemon.path().join(file), "").unwrap();
    }
    daemon.spawn();
    let wrong = daemon.worker();
    assert!(!daemon.path().join("wrong").exists());
    is_replaced(&daemon, wrong);
}

/// Some of its threads would serve other clients.
#[test]
fn a_worker_that_does_not_answer_its_supervisor_is_replaced() {
    let daemon = TestDaemon::start_binary(program("pairmaskd_hanging"), &PROBE);
    fs::write(daemon.path().join("fit"), "").unwrap();
    is_replaced(&daemon, daemon.worker());
}

#[test]
fn a_worker_whose_socket_is_gone_or_replaced_is_replaced() {
    let daemon = TestDaemon::start(&PROBE);
    let path = daemon.path().join("default.socket");
    let worker = daemon.worker();
    fs::remove_file(&path).unwrap();
    is_replaced(&daemon, worker);

    let worker = daemon.worker();
    fs::remove_file(&path).unwrap();
    // Nobody accepts what comes here.
    let silent = socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
    bind(&silent, &SocketAddrUnix::new(&path).unwrap()).unwrap();
    listen(&silent, 8).unwrap();
    is_replaced(&daemon, worker);

    let worker = daemon.worker();
    fs::remove_file(&path).unwrap();
    fs::write(&path, "").unwrap();
    is_replaced(&daemon, worker);
}

/// More threads than cores, each of which keeps a core, and frames that wait for each other.
#[test]
fn a_busy_worker_with_all_its_clients_stays_and_its_supervisor_is_not_counted() {
    let clients = 6;
    let busy = [&PROBE[..], &["--max-clients", "6"]].concat();
    let daemon = TestDaemon::start(&busy);
    let worker = daemon.worker();
    let boxes: Vec<Aabb> = (0..30_000).map(|i| at((i % 1000) as f32)).collect();
    let mut sessions: Vec<_> = (0..clients).map(|_| daemon.connect()).collect();
    let end = AtomicBool::new(false);
    let frames: u64 = std::thread::scope(|scope| {
        let busy: Vec<_> = sessions
            .iter_mut()
            .map(|session| {
                scope.spawn(|| {
                    let mut frames = 0;
                    while !end.load(Ordering::Relaxed) {
                        session.answer(&boxes);
                        frames += 1;
                    }
                    frames
                })
            })
            .collect();
        for _ in 0..4 {
            scope.spawn(|| {
                while !end.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        std::thread::sleep(Duration::from_secs(4));
        assert!(matches!(daemon.session().connect(), Err(ConnectError::TooManyClients { .. })));
        end.store(true, Ordering::Relaxed);
        busy.into_iter().map(|client| client.join().unwrap()).sum()
    });
    assert_eq!(daemon.worker(), worker);
    let status = sessions[0].daemon_status().unwrap();
    assert_eq!((status.client_count, status.frames, status.errors), (clients, frames, 0));
}

fn limit_files(process: Pid, files: Option<u64>) {
    let own = getrlimit(Resource::Nofile);
    let limit = Rlimit { current: files.or(own.current), ..own };
    prlimit(Some(process), Resource::Nofile, limit).unwrap();
}

#[test]
fn a_daemon_without_files_to_open_keeps_nobody_waiting_and_recovers() {
    let daemon = TestDaemon::of_cores();
    let mut first = daemon.connect();
    assert_eq!(frame(&mut first, UNIT).unwrap(), (1, ServedBy::Daemon));
    let worker = daemon.worker();
    let open = std::fs::read_dir(format!("/proc/{}/fd", worker.as_raw_nonzero())).unwrap().count();
    let (auto, insisting) = (daemon.session().backend(Backend::Auto), daemon.session());
    let mut returning = None;
    // Connecting ends early, half way and late.
    for spare in 0..8 {
        limit_files(worker, Some(open as u64 + spare));
        let start = Instant::now();
        let mut session = auto.clone().connect().unwrap();
        assert_eq!(frame(&mut session, UNIT).unwrap(), (1, ServedBy::InProcess), "{spare}");
        returning = Some(session);
        let refused = insisting.clone().connect().unwrap_err().to_string();
        assert!(refused.contains("RLIMIT_NOFILE"), "{spare}: {refused}");
        assert_eq!(frame(&mut first, UNIT).unwrap(), (1, ServedBy::Daemon), "{spare}");
        assert!(start.elapsed() < Duration::from_secs(2), "{spare}: {:?}", start.elapsed());
    }
    limit_files(worker, None);
    for mut session in [returning.unwrap(), auto.connect().unwrap()] {
        until("the daemon serves it", || {
            frame(&mut session, UNIT).unwrap() == (1, ServedBy::Daemon)
        });
    }
    assert_eq!(daemon.worker(), worker);
}
