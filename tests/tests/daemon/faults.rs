//! Processes that die, hang or forge messages, and limits that they meet. The other side goes on with right answers.

use std::process::Command;
use std::time::{Duration, Instant};

use pairmask::SceneOptions;
use pairmask_core::objects::ObjectForm;
use pairmask_tests::attackers::raw::RawClient;
use pairmask_tests::daemon::{outlive_kills, program, stop};
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::frames::{served_by, two_sets};
use pairmask_tests::prelude::*;
use pairmask_tests::spheres::{check_mask, cull, whole_scene};
use pairmask_transport::{DaemonRecord, Heartbeat, RuntimeDir};
use pairmask_wire::{
    CullRequest, InstanceName, ReplyError, RequestHeader, SceneSections, StatusCode, Version,
};

/// Submits a frame and compares with the oracle. Returns what served it.
fn check_frame(session: &mut Session, boxes: &[Aabb]) -> ServedBy {
    let mask = session.answer(boxes);
    assert_eq!(mask.sorted(), oracle::truth(boxes).pairs);
    mask.info().served_by
}

fn comes_back(session: &mut Session, boxes: &[Aabb]) {
    until("the session comes back to the daemon", || {
        check_frame(session, boxes) == ServedBy::Daemon
    });
}

fn scene(n: usize, seed: u64) -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(n as u32, seed)
}

#[test]
fn a_thousand_frames_are_right_while_the_daemon_is_killed_again_and_again() {
    let mut daemon = TestDaemon::start(&[]);
    let mut session = daemon.connect_auto();
    let scenes: Vec<_> = (0..8).map(|seed| scene(300, seed)).collect();
    let spheres: Vec<_> = (0..8).map(|seed| whole_scene(300, 12, seed)).collect();
    outlive_kills(&mut daemon, |i| {
        if i % 2 == 0 {
            return check_frame(&mut session, &scenes[i % scenes.len()]);
        }
        let (spheres, truth) = &spheres[i % spheres.len()];
        let mask = cull(&mut session, spheres);
        assert_eq!(check_mask(&mask, mask.encoding(), truth), Ok(()));
        mask.info().served_by
    });
}

/// Answers lie in the daemon's memory: they stay as they are, however it ends.
#[test]
fn answers_in_hand_outlast_their_daemon() {
    let ends: [fn(&mut TestDaemon); 2] = [TestDaemon::stop, TestDaemon::kill];
    for end in ends {
        let mut daemon = TestDaemon::start(&[]);
        let mut session = daemon.connect();
        let boxes = scene(2_000, 1);
        let expected = oracle::truth(&boxes).pairs;
        let masks = [session.answer(&boxes), session.answer(&boxes[..1_000])];
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let answer = scene.edit().set_all(0..2_000, &boxes).commit(Report::Changes).unwrap();
        end(&mut daemon);
        assert!(!expected.is_empty() && masks[0].sorted() == expected);
        assert_eq!(masks[1].sorted(), oracle::truth(&boxes[..1_000]).pairs);
        assert_eq!(answer.begun().to_vec(), expected);
    }
}

#[test]
fn a_daemon_killed_with_frames_under_way_costs_no_answer() {
    let mut daemon = TestDaemon::start(&[]);
    let mut session = daemon.connect_auto();
    let (boxes, (spheres, truth)) = (scene(400, 1), whole_scene(400, 12, 1));
    check_frame(&mut session, &boxes);
    daemon.signal_worker(Signal::STOP);
    let (of_boxes, of_spheres) = (session.ask(&boxes), session.ask_spheres(&spheres));
    // One more that is filled and not yet sent.
    let mut filled = session.sphere_frame(spheres.len()).unwrap();
    assert!(filled.is_shared());
    filled.spheres_mut().copy_from_slice(&spheres);
    daemon.kill();
    let mask = of_boxes.wait().unwrap();
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    assert_eq!(mask.sorted(), oracle::truth(&boxes).pairs);
    for frame in [of_spheres, filled.submit().unwrap()] {
        let mask = frame.wait().unwrap();
        assert_eq!(mask.info().served_by, ServedBy::InProcess);
        assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()));
    }
    // A session without a stand-in says so.
    daemon.restart();
    let mut strict = eventually("a session without a stand-in", || daemon.session().connect().ok());
    daemon.signal_worker(Signal::STOP);
    let pending = [strict.ask(&boxes), strict.ask_spheres(&spheres)];
    daemon.kill();
    for pending in pending {
        assert!(matches!(pending.wait(), Err(Error::DaemonDied)));
    }
}

#[test]
fn a_daemon_that_hangs_costs_a_deadline_and_no_answer() {
    let daemon = TestDaemon::start(&[]);
    let deadline = Duration::from_millis(200);
    let mut session = daemon.session().backend(Backend::Auto).deadline(deadline).connect().unwrap();
    let boxes = scene(200, 2);
    // A busy machine may hold its heartbeat up, which sends a frame home too.
    comes_back(&mut session, &boxes);
    daemon.signal_worker(Signal::STOP);
    assert_eq!(check_frame(&mut session, &boxes), ServedBy::InProcess);
    daemon.signal_worker(Signal::CONT);
    comes_back(&mut session, &boxes);
}

/// The bounds are those of a hang: 200 ms and a second are asked for, 30 s and the deadline were taken.
#[test]
fn a_stopped_worker_is_replaced_and_no_frame_waits_for_it() {
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_secs(60);
    let mut session = daemon.session().backend(Backend::Auto).deadline(deadline).connect().unwrap();
    let boxes = scene(200, 2);
    for round in 0..3 {
        comes_back(&mut session, &boxes);
        let stopped = daemon.worker();
        stop(stopped);
        let mut slowest = Duration::ZERO;
        until("another worker serves", || {
            let start = Instant::now();
            check_frame(&mut session, &boxes);
            slowest = slowest.max(start.elapsed());
            daemon.worker() != stopped
        });
        assert!(slowest < deadline / 6, "round {round}: {slowest:?}");
    }
    comes_back(&mut session, &boxes);
}

/// A daemon whose worker stays stopped, as with its supervisor, is left after one frame, and asked again as
/// soon as it runs.
#[test]
fn a_silent_daemon_costs_one_frame_until_it_runs_again() {
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_secs(60);
    let mut session = daemon.session().backend(Backend::Auto).deadline(deadline).connect().unwrap();
    let boxes = scene(200, 3);
    for _ in 0..2 {
        comes_back(&mut session, &boxes);
        daemon.signal_worker(Signal::STOP);
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(3) {
            assert_eq!(check_frame(&mut session, &boxes), ServedBy::InProcess);
        }
        assert!(start.elapsed() < deadline / 6, "{:?}", start.elapsed());
        daemon.signal_worker(Signal::CONT);
    }
}

#[test]
fn a_frame_that_is_polled_for_leaves_a_silent_daemon_too() {
    let (daemon, mut session) = served_or_here();
    let boxes = scene(200, 4);
    comes_back(&mut session, &boxes);
    daemon.signal_worker(Signal::STOP);
    let mut pending = session.ask(&boxes);
    let mask = eventually("the frame is answered", || {
        std::thread::sleep(Duration::from_millis(1));
        pending.try_receive().unwrap()
    });
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    daemon.signal_worker(Signal::CONT);
}

/// Runs `fault_client connect` below a command that limits it or gives it a namespace.
fn connect_below(daemon: &TestDaemon, shell: &str) -> String {
    let output = Command::new("bash")
        .args(["-c", &format!("{shell} {} connect", program("fault_client").display())])
        .env("PAIRMASK_RUNTIME_DIR", daemon.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    said
}

/// A namespace of process ids of its own, as a container has one. Without root it takes one of users.
const PID_NAMESPACE: &str = "unshare --user --map-root-user --pid --fork --mount-proc";

#[test]
fn a_daemon_is_found_from_another_pid_namespace() {
    let daemon = TestDaemon::of_cores();
    assert_eq!(connect_below(&daemon, PID_NAMESPACE), "connected\n");
    assert_eq!(connect_below(&daemon, ""), "connected\n");
}

#[test]
fn limits_of_a_client_are_named() {
    let daemon = TestDaemon::of_cores();
    let said = connect_below(&daemon, "ulimit -n 8;");
    assert!(said.contains("Limit(Files { limit: 8 })"), "{said}");
    // What is mapped goes by what is asked for, not by what a daemon may answer with.
    assert_eq!(connect_below(&daemon, "ulimit -v 1000000;"), "connected\n");
}

#[test]
fn a_client_takes_no_more_files_of_the_worker_than_are_counted_for_it() {
    let daemon = TestDaemon::of_cores();
    let files = || {
        let folder = format!("/proc/{}/fd", daemon.worker().as_raw_nonzero());
        std::fs::read_dir(folder).unwrap().count() as u64
    };
    let mut first = daemon.connect();
    check_frame(&mut first, &scene(9, 1));
    let before = files();
    let clients = 6;
    let mut sessions: Vec<_> = (0..clients).map(|_| daemon.connect()).collect();
    // A larger frame makes a second port.
    for n in [9, 80_000] {
        for session in &mut sessions {
            session.answer(&vec![Aabb::EMPTY; n]);
        }
    }
    let each = (files() - before).div_ceil(clients);
    assert!(each > 0 && each < pairmaskd::serve::FILES_PER_CLIENT, "{each} a client");
}

#[test]
fn a_client_killed_in_mid_frame_leaves_the_others_alone_and_its_memory_comes_back() {
    let daemon = TestDaemon::start(&[]);
    let mut other = daemon.connect();
    let boxes = scene(300, 3);
    check_frame(&mut other, &boxes);
    let before = daemon.segments().len();
    for mode in ["loan", "pending"] {
        let mut victim = FaultClient::start(&daemon, &[mode, "auto"]);
        victim.go();
        assert!(daemon.segments().len() > before, "the victim has memory of its own");
        drop(victim);
        let killed = Instant::now();
        until("the victim's memory goes", || {
            check_frame(&mut other, &boxes);
            daemon.segments().len() == before
        });
        assert!(killed.elapsed() < Duration::from_secs(10), "mode {mode}");
    }
    assert_eq!(check_frame(&mut other, &boxes), ServedBy::Daemon);
}

/// The pages that are missing read as zeros, and no other client notices anything.
#[test]
fn a_truncated_segment_harms_nobody_else() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let (mut other, boxes) = (daemon.connect(), scene(300, 4));
    let worker = daemon.worker();
    for engine in ["cpu-brute", "gpu-brute"] {
        daemon.wait_for_gpus();
        let mut vandal = FaultClient::start(&daemon, &["truncate", engine]);
        daemon.signal_worker(Signal::STOP);
        vandal.go();
        daemon.signal_worker(Signal::CONT);
        for _ in 0..20 {
            check_frame(&mut other, &boxes);
        }
        drop(vandal);
        check_frame(&mut other, &boxes);
        assert_eq!(daemon.worker(), worker, "{engine}: the worker lives");
    }
}

type Change = fn(&mut RequestHeader);

/// Sends changed requests of ten objects over the transport, and checks their statuses. Returns the daemon's counts.
fn check_forged(
    form: impl Into<ObjectForm>,
    changes: &[(Change, StatusCode)],
) -> pairmask::DaemonStatus {
    let daemon = TestDaemon::start(&[]);
    let worker = daemon.worker();
    let client = RawClient::connect_at(&daemon.dir(), 2).unwrap();
    let scene = SceneSections::first(form.into(), BoxCount::new(10));
    for (number, (change, expected)) in changes.iter().enumerate() {
        let mut header = RequestHeader::cull(77, 1, &CullRequest::of(scene));
        change(&mut header);
        let mut loan = client.loan().unwrap();
        loan.header = header;
        let status = client.send(loan).answer(TIMEOUT).unwrap().status;
        assert_eq!(status, *expected as u32, "request {number}");
    }
    assert_eq!(daemon.worker(), worker, "the worker still lives");
    daemon.connect().daemon_status().unwrap()
}

const OK: StatusCode = StatusCode::Ok;
const BAD: StatusCode = StatusCode::BadRequest;
const VERSION: StatusCode = StatusCode::VersionMismatch;

#[test]
fn forged_requests_are_answered_and_harm_no_client() {
    let status = check_forged(
        BoxForm::F32,
        &[
            (|_| {}, OK),
            (|h| *h = RequestHeader::default(), BAD),
            (|h| h.version_major = 2, VERSION),
            (|h| h.box_count = u32::MAX, BAD),
            (|h| h.sections[0].offset = u64::MAX - 7, BAD),
            (|h| h.sections[0].bytes = u64::MAX, BAD),
            (|h| h.sections[0].offset = 8192, BAD),
            (|h| h.engine = 1000, BAD),
            (|h| h.threads = u32::MAX, OK),
        ],
    );
    assert_eq!((status.frames, status.errors), (2, 7));
    assert_eq!(status.last_errors[5].status, VERSION as u32);
    let status = check_forged(
        ObjectForm::Spheres,
        &[
            (|_| {}, OK),
            // As many as fit into two pages, and one more.
            (|h| (h.box_count, h.sections[0].bytes) = (512, 512 * 16), OK),
            (|h| (h.box_count, h.sections[0].bytes) = (513, 513 * 16), BAD),
            (|h| (h.box_count, h.sections[0].bytes) = (u32::MAX, (1 << 36) - 16), BAD),
            (|h| h.sections[0].offset = 8192 - 156, BAD),
            (|h| h.sections[0].offset = 2, BAD),
            (|h| h.sections[0].bytes = 240, BAD),
            (|h| h.sections[0].kind = 1, BAD),
            (|h| h.sections[1] = h.sections[0], BAD),
            (|h| h.threads = u32::MAX, OK),
        ],
    );
    assert_eq!((status.frames, status.spheres, status.errors), (3, 532, 7));
}

#[test]
fn a_mask_larger_than_a_reply_is_answered_in_process_or_named() {
    let daemon = TestDaemon::start(&["--max-reply-mib", "1"]);
    let same = vec![Aabb::new([0.0; 3], [1.0; 3]); 5000];
    let submit = |session: &mut Session| session.ask(&same).wait();
    let error = submit(&mut daemon.connect()).unwrap_err();
    assert!(error.to_string().contains("reply-too-large"), "{error}");
    let mask = submit(&mut daemon.connect_auto()).unwrap();
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    assert_eq!(mask.count(), 5000 * 4999 / 2);
}

#[test]
fn a_missing_daemon_and_another_version_are_distinguished() {
    let dir = tempfile::tempdir().unwrap();
    let slot = RuntimeDir::at(dir.path());
    let builder = Session::builder().runtime_dir(slot.clone()).backend(Backend::Daemon);
    let connect = || builder.clone().connect().unwrap_err();
    assert!(matches!(connect(), ConnectError::NoDaemon { .. }));
    let (pid, name) = (std::process::id(), InstanceName::default());
    let record = |worker_pid, version| {
        let record = DaemonRecord { worker_pid, supervisor_pid: pid, version, fences: 0 };
        slot.write_record(&name, &record).unwrap();
    };
    let older = Version { minor: Version::CURRENT.minor - 1, ..Version::CURRENT };
    for version in [older, Version { major: 2, minor: 0 }] {
        record(pid, version);
        assert!(matches!(connect(), ConnectError::VersionMismatch { .. }), "{version}");
    }
    record(u32::MAX >> 1, Version::CURRENT);
    assert!(matches!(connect(), ConnectError::NoDaemon { .. }));
    // A dead daemon's process id may be another process's by now.
    record(pid, Version::CURRENT);
    drop(Heartbeat::start(&slot, &name).unwrap());
    let error = connect();
    assert!(matches!(error, ConnectError::NoDaemon { .. }), "{error}");
    let said = error.to_string();
    assert!(said.contains(dir.path().to_str().unwrap()) && said.contains("'default'"), "{said}");
}

#[test]
fn three_frames_at_a_time_and_no_fourth() {
    let daemon = TestDaemon::start(&[]);
    let mut session = daemon.connect();
    let boxes = scene(64, 6);
    let expected = oracle::truth(&boxes).pairs;
    let pending = [(); 3].map(|()| session.ask(&boxes));
    assert!(matches!(session.frame(1).unwrap_err(), Error::TooManyFrames));
    let masks = pending.map(|frame| frame.wait().unwrap());
    assert!(masks.iter().all(|mask| mask.sorted() == expected));
    assert!(matches!(session.frame(1).unwrap_err(), Error::TooManyFrames));
    drop(masks);
    check_frame(&mut session, &boxes);
}

#[test]
fn an_auto_session_answers_a_fourth_frame_itself() {
    let daemon = TestDaemon::of_cores();
    let mut session = daemon.connect_auto();
    let boxes = scene(64, 6);
    let held = [(); 3].map(|()| served_by(ServedBy::Daemon, || session.answer(&boxes)));
    for _ in 0..2 {
        assert_eq!(check_frame(&mut session, &boxes), ServedBy::InProcess);
    }
    drop(held);
    comes_back(&mut session, &boxes);
    // This process has no GPU.
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    let builder = daemon.session().backend(Backend::Auto).engine(engine);
    let mut session = builder.connect().unwrap();
    let _held: Vec<_> = (0..3).map(|_| session.frame(9).unwrap()).collect();
    let is_refused = matches!(session.frame(9), Err(Error::TooManyFrames));
    assert!(is_refused || session.served_by() == ServedBy::InProcess);
}

/// Frames of boxes, of two sets and of spheres, and scenes.
#[test]
fn what_is_asked_of_a_gpu_that_is_not_there_is_refused() {
    let daemon = TestDaemon::of_cores();
    let (boxes, spheres) = ([at(0.0); 4], [Sphere::EMPTY; 2]);
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let mut session = daemon.connect_to(engine);
        let mut answers = vec![
            session.ask(&boxes).wait().map(drop),
            session.ask_with(&boxes, &two_sets(2)).wait().map(drop),
            session.ask_spheres(&spheres).wait().map(drop),
        ];
        if engine == EngineName::GpuGrid {
            let mut scene = session.scene(SceneOptions::default()).unwrap();
            answers.push(scene.edit().set(0, at(0.0)).commit(Report::All).map(drop));
        }
        for answer in answers {
            let Err(Error::Reply(ReplyError::Status { status, .. })) = answer else {
                panic!("{answer:?}")
            };
            assert_eq!(status, StatusCode::EngineUnavailable);
        }
        let builder = daemon.session().engine(EngineChoice::Only(engine));
        let mut session = builder.backend(Backend::InProcess).connect().unwrap();
        let mut frame = session.sphere_frame(2).unwrap();
        frame.spheres_mut().fill(Sphere::EMPTY);
        let answer = frame.submit().unwrap_err();
        assert!(matches!(answer, Error::Cull(CullError::Unavailable { .. })), "{answer}");
    }
}
