//! Processes that die, forge messages or run out of memory. The other side goes on with right
//! answers. One file, because each fault is a test of its own that shares the same client and comparisons.

use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use pairmask_core::objects::ObjectForm;
use pairmask_tests::daemon::{outlive_kills, stop};
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::frames::served_by;
use pairmask_tests::prelude::*;
use pairmask_tests::spheres::{check_mask, cull, whole_scene};
use pairmask_transport::{DaemonRecord, Heartbeat, RuntimeDir, Services};
use pairmask_wire::{CullRequest, InstanceName, RequestHeader, ScenePlace, StatusCode, Version};
use rustix::process::{Pid, getpid};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const FAULT_CLIENT: &str = env!("CARGO_BIN_EXE_fault_client");

/// Submits a frame and compares with the oracle. Returns what served it.
fn check_frame(session: &mut Session, boxes: &[Aabb]) -> ServedBy {
    let mask = session.answer(boxes);
    assert_eq!(mask.sorted(), oracle::truth(boxes).pairs);
    mask.info().served_by
}

fn comes_back(session: &mut Session, boxes: &[Aabb]) {
    eventually("the session comes back to the daemon", || {
        (check_frame(session, boxes) == ServedBy::Daemon).then_some(())
    });
}

fn scene(n: usize, seed: u64) -> Vec<Aabb> {
    stress_scenes::named("uniform").boxes(n as u32, seed)
}

#[test]
fn a_thousand_frames_are_right_while_the_daemon_is_killed_again_and_again() {
    let mut daemon = TestDaemon::start(DAEMON, &[]);
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
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

#[test]
fn a_daemon_killed_with_frames_under_way_costs_no_answer() {
    let mut daemon = TestDaemon::start(DAEMON, &[]);
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    let (boxes, (spheres, truth)) = (scene(400, 1), whole_scene(400, 12, 1));
    let fill = |session: &mut Session| {
        let mut frame = session.sphere_frame(spheres.len()).unwrap();
        assert!(frame.is_shared());
        frame.spheres_mut().copy_from_slice(&spheres);
        frame
    };
    check_frame(&mut session, &boxes);
    daemon.signal_worker(Signal::STOP);
    let of_boxes = session.ask(&boxes);
    let of_spheres = fill(&mut session).submit().unwrap();
    // One more that is filled and not yet sent.
    let filled = fill(&mut session);
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
    let pending = [strict.ask(&boxes), fill(&mut strict).submit().unwrap()];
    daemon.kill();
    for pending in pending {
        assert!(matches!(pending.wait(), Err(Error::DaemonDied)));
    }
}

#[test]
fn a_daemon_that_hangs_costs_a_deadline_and_no_answer() {
    let daemon = TestDaemon::start(DAEMON, &[]);
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
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let deadline = Duration::from_secs(60);
    let mut session = daemon.session().backend(Backend::Auto).deadline(deadline).connect().unwrap();
    let boxes = scene(200, 2);
    for round in 0..3 {
        comes_back(&mut session, &boxes);
        let stopped = daemon.worker();
        stop(stopped);
        let mut slowest = Duration::ZERO;
        eventually("another worker serves", || {
            let start = Instant::now();
            check_frame(&mut session, &boxes);
            slowest = slowest.max(start.elapsed());
            daemon
                .record()
                .is_some_and(|record| record.worker_pid != stopped.as_raw_nonzero().get() as u32)
                .then_some(())
        });
        assert!(slowest < deadline / 6, "round {round}: {slowest:?}");
    }
    comes_back(&mut session, &boxes);
}

/// A daemon whose worker stays stopped, as with its supervisor, is left after one frame, and asked again as
/// soon as it runs.
#[test]
fn a_silent_daemon_costs_one_frame_until_it_runs_again() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
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
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    let boxes = scene(200, 4);
    comes_back(&mut session, &boxes);
    daemon.signal_worker(Signal::STOP);
    let mut pending = session.ask(&boxes);
    let mask = eventually("the frame is answered", || {
        std::thread::sleep(Duration::from_millis(1));
        pending.try_take().unwrap()
    });
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    daemon.signal_worker(Signal::CONT);
}

/// Runs `fault_client connect` below a command that limits it or gives it a namespace.
fn connect_below(daemon: &TestDaemon, shell: &str) -> String {
    let output = Command::new("bash")
        .args(["-c", &format!("{shell} {FAULT_CLIENT} connect")])
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
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    assert_eq!(connect_below(&daemon, PID_NAMESPACE), "connected\n");
    assert_eq!(connect_below(&daemon, ""), "connected\n");
}

#[test]
fn limits_of_a_client_are_named() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let said = connect_below(&daemon, "ulimit -v 8000000;");
    assert!(said.contains("Limit(AddressSpace") && said.contains("8192000000"), "{said}");
    let said = connect_below(&daemon, "ulimit -n 20;");
    assert!(said.contains("Limit(Files { limit: 20 })"), "{said}");
    // With room for replies that are small enough all is well.
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--max-reply-mib", "16"]);
    assert_eq!(connect_below(&daemon, "ulimit -v 8000000;"), "connected\n");
}

#[test]
fn a_client_takes_no_more_files_of_the_worker_than_are_counted_for_it() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let files = || {
        let folder = format!("/proc/{}/fd", daemon.worker().as_raw_nonzero());
        std::fs::read_dir(folder).unwrap().count() as u64
    };
    let mut first = daemon.session().connect().unwrap();
    check_frame(&mut first, &scene(9, 1));
    let before = files();
    let clients = 6;
    let mut sessions: Vec<_> = (0..clients).map(|_| daemon.session().connect().unwrap()).collect();
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
fn a_daemon_whose_files_are_removed_starts_anew() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let boxes = scene(100, 5);
    check_frame(&mut daemon.session().connect().unwrap(), &boxes);
    for file in daemon.shared_files() {
        std::fs::remove_file(file).unwrap();
    }
    let mut session = eventually("the daemon serves again", || match daemon.session().connect() {
        Ok(session) => Some(session),
        Err(ConnectError::FilesGone { .. } | ConnectError::NoDaemon { .. }) => None,
        Err(error) => panic!("{error}"),
    });
    assert_eq!(check_frame(&mut session, &boxes), ServedBy::Daemon);
}

#[test]
fn a_client_killed_in_mid_frame_leaves_the_others_alone_and_its_memory_comes_back() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let mut other = daemon.session().connect().unwrap();
    let boxes = scene(300, 3);
    check_frame(&mut other, &boxes);
    let before = daemon.shared_files();
    for mode in ["loan", "pending"] {
        let mut victim = FaultClient::start(FAULT_CLIENT, &daemon, &[mode, "auto"]);
        victim.go();
        assert!(daemon.shared_files().len() > before.len(), "the victim has files of its own");
        drop(victim);
        let killed = Instant::now();
        eventually("the victim's files go", || {
            check_frame(&mut other, &boxes);
            (daemon.shared_files() == before).then_some(())
        });
        assert!(killed.elapsed() < Duration::from_secs(10), "mode {mode}");
    }
    assert_eq!(check_frame(&mut other, &boxes), ServedBy::Daemon);
}

/// Boxes with dense masks of so many bytes: all in one place.
fn boxes_of_mask(bytes: f64) -> Vec<Aabb> {
    vec![Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); (16.0 * bytes).sqrt() as usize]
}

/// Memory of masks that is left to a daemon whose clients have large ones no more.
const LEFT_OF_MASKS: u64 = 512 << 10;

#[test]
fn memory_of_replies_is_given_back_when_clients_leave_and_the_others_notice_nothing() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let stays = scene(1000, 7);
    let mut steady = daemon.session().answer_repeats(false).connect().unwrap();
    check_frame(&mut steady, &stays);
    let before = daemon.shared_bytes();
    let boxes = boxes_of_mask(4e6);
    let dense = EncodingChoice::Only(Encoding::Dense);
    for _ in 0..3 {
        let mut sessions: Vec<Session> =
            (0..4).map(|_| daemon.session().encoding(dense).connect().unwrap()).collect();
        let masks: Vec<_> = sessions.iter_mut().map(|session| session.answer(&boxes)).collect();
        let all = boxes.len() as u64 * (boxes.len() as u64 - 1) / 2;
        assert!(masks.iter().all(|mask| mask.count() == all));
        assert!(daemon.shared_bytes() > before + 15_000_000, "masks in the hands of clients");
        drop(masks);
        drop(sessions);
        eventually("the memory of masks comes back", || {
            assert_eq!(check_frame(&mut steady, &stays), ServedBy::Daemon);
            (daemon.shared_bytes() < before + LEFT_OF_MASKS).then_some(())
        });
    }
}

#[test]
#[ignore = "takes minutes and 2 GB of /dev/shm: cargo test --release -p pairmask-tests --test daemon -- --ignored faults"]
fn two_hundred_clients_of_60_000_boxes_leave_8_mb_of_shared_memory_at_most() {
    const AT_A_TIME: usize = 8;
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    drop(daemon.session().connect().unwrap());
    let before = daemon.shared_bytes();
    let dense = EncodingChoice::Only(Encoding::Dense);
    let boxes = scene(60_000, 5);
    let mut most = 0;
    for _ in 0..200 / AT_A_TIME {
        let mut sessions: Vec<Session> =
            (0..AT_A_TIME).map(|_| daemon.session().encoding(dense).connect().unwrap()).collect();
        let _masks: Vec<_> = sessions.iter_mut().map(|session| session.answer(&boxes)).collect();
        most = most.max(daemon.shared_bytes());
    }
    assert!(most > before + AT_A_TIME as u64 * 200_000_000);
    let left = || daemon.shared_bytes().saturating_sub(before);
    eventually("the memory of masks comes back", || (left() < 8_000_000).then_some(()));
    println!("{most} bytes at most, {} left of {before}", left());
}

/// What a client has in its hands is nobody's to give back.
#[test]
fn a_mask_in_the_hands_of_a_client_stays_what_it_is_while_others_leave() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let dense = EncodingChoice::Only(Encoding::Dense);
    let boxes = boxes_of_mask(1e6);
    let mut holder = daemon.session().encoding(dense).connect().unwrap();
    let held = holder.answer(&boxes);
    let all = boxes.len() as u64 * (boxes.len() as u64 - 1) / 2;
    let before = daemon.shared_bytes();
    for _ in 0..3 {
        let mut leaves = daemon.session().encoding(dense).connect().unwrap();
        drop(leaves.answer(&boxes));
        drop(leaves);
        eventually("the memory of the other mask comes back", || {
            (daemon.shared_bytes() < before + LEFT_OF_MASKS).then_some(())
        });
        assert_eq!(held.count(), all);
    }
}

/// A container's /dev/shm has 64 MB.
#[test]
fn clients_of_few_boxes_take_little_shared_memory() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let before = daemon.shared_bytes();
    let boxes = scene(1000, 3);
    let mut sessions: Vec<Session> = (0..16).map(|_| daemon.session().connect().unwrap()).collect();
    for session in &mut sessions {
        check_frame(session, &boxes);
    }
    let each = (daemon.shared_bytes() - before) / 16;
    // 24 kB of boxes, an answer of some kB, and what the transport has for each.
    assert!(each < 256 << 10, "{each} bytes a client");
}

#[test]
fn a_truncated_segment_kills_a_worker_at_most() {
    truncate_a_segment("cpu-brute");
}

/// A software driver reads the boxes on the CPU and dies of the SIGBUS; a real GPU reads the rest
/// of the memory.
#[test]
fn a_segment_truncated_under_the_gpu_kills_a_worker_at_most() {
    truncate_a_segment("gpu-brute");
}

fn truncate_a_segment(engine: &str) {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let mut other = daemon.session().backend(Backend::Auto).connect().unwrap();
    let boxes = scene(300, 4);
    check_frame(&mut other, &boxes);
    let first_worker = daemon.worker();
    let mut vandal = FaultClient::start(FAULT_CLIENT, &daemon, &["truncate", engine]);
    daemon.signal_worker(Signal::STOP);
    vandal.go();
    daemon.signal_worker(Signal::CONT);
    eventually("another worker serves", || {
        check_frame(&mut other, &boxes);
        (daemon.worker() != first_worker).then_some(())
    });
    drop(vandal);
    comes_back(&mut other, &boxes);
}

type Change = fn(&mut RequestHeader);

/// Sends changed requests of ten objects over the transport, and checks their statuses. Returns the daemon's counts.
fn check_forged(
    form: impl Into<ObjectForm>,
    changes: &[(Change, StatusCode)],
) -> pairmask::DaemonStatus {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let worker = daemon.worker();
    let services = Services::connect(&daemon.dir(), &InstanceName::default()).unwrap();
    let client = services.client(77, 4).unwrap();
    let scene = ScenePlace::first(form.into(), BoxCount::new(10));
    for (number, (change, expected)) in changes.iter().enumerate() {
        let mut header = RequestHeader::cull(77, 1, &CullRequest::of(scene));
        change(&mut header);
        let loan = client.port.loan_slice_uninit(2).unwrap();
        let mut loan = pairmask_transport::assume_pages(loan);
        *loan.user_header_mut() = header;
        let pending = loan.send().unwrap();
        client.notifier.notify().unwrap();
        let status =
            eventually("a response", || Some(pending.receive().unwrap()?.user_header().status));
        assert_eq!(status, *expected as u32, "request {number}");
    }
    assert_eq!(daemon.worker(), worker, "the worker still lives");
    daemon.session().connect().unwrap().daemon_status().unwrap()
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
fn a_full_shm_is_a_typed_error_and_no_death() {
    for mode in ["full", "full-spheres"] {
        let daemon_dir = tempfile::tempdir().unwrap();
        // A namespace of its own with 2 MB of shared memory: daemon and client in one.
        let script = format!(
            "mount -t tmpfs -o size=2m tmpfs /dev/shm || exit; {DAEMON} serve & daemon=$!; \
             for i in $(seq 300); do [ -e {dir}/default.daemon ] && break; sleep 0.05; done; \
             {FAULT_CLIENT} {mode}; code=$?; kill $daemon; wait; exit $code",
            dir = daemon_dir.path().display(),
        );
        let output = Command::new("unshare")
            .args(["--user", "--map-root-user", "--mount", "bash", "-c", &script])
            .env("PAIRMASK_RUNTIME_DIR", daemon_dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(said.contains("no shared memory for"), "{mode}: {said}");
    }
}

#[test]
fn a_mask_larger_than_a_reply_is_answered_in_process_or_named() {
    let daemon = TestDaemon::start(DAEMON, &["--max-reply-mib", "1"]);
    let same = vec![Aabb::new([0.0; 3], [1.0; 3]); 5000];
    let submit = |session: &mut Session| session.ask(&same).wait();
    let error = submit(&mut daemon.session().connect().unwrap()).unwrap_err();
    assert!(error.to_string().contains("reply-too-large"), "{error}");
    let mask = submit(&mut daemon.session().backend(Backend::Auto).connect().unwrap()).unwrap();
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    assert_eq!(mask.count(), 5000 * 4999 / 2);
}

#[test]
fn a_missing_daemon_and_another_version_are_distinguished() {
    let dir = tempfile::tempdir().unwrap();
    let connect = || {
        Session::builder()
            .runtime_dir(RuntimeDir::at(dir.path()))
            .backend(Backend::Daemon)
            .connect()
            .unwrap_err()
    };
    assert!(matches!(connect(), ConnectError::NoDaemon { .. }));
    let pid = std::process::id();
    let record = |version| DaemonRecord { worker_pid: pid, supervisor_pid: pid, version };
    let older = Version { minor: Version::CURRENT.minor - 1, ..Version::CURRENT };
    for other in [older, Version { major: 2, minor: 0 }] {
        let record = record(other);
        RuntimeDir::at(dir.path()).write_record(&InstanceName::default(), &record).unwrap();
        assert!(matches!(connect(), ConnectError::VersionMismatch { .. }), "{other}");
    }
    let record = record(Version::CURRENT);
    let dead = DaemonRecord { worker_pid: u32::MAX >> 1, ..record };
    RuntimeDir::at(dir.path()).write_record(&InstanceName::default(), &dead).unwrap();
    assert!(matches!(connect(), ConnectError::NoDaemon { .. }));
    // A dead daemon's process id may be another process's by now.
    RuntimeDir::at(dir.path()).write_record(&InstanceName::default(), &record).unwrap();
    drop(Heartbeat::start(&RuntimeDir::at(dir.path()), &InstanceName::default()).unwrap());
    let error = connect();
    assert!(matches!(error, ConnectError::NoDaemon { .. }), "{error}");
    let said = error.to_string();
    assert!(said.contains(dir.path().to_str().unwrap()) && said.contains("'default'"), "{said}");
}

#[test]
fn another_users_daemon_is_named() {
    const NOBODY: u32 = 65_534;
    if !rustix::process::geteuid().is_root() {
        // Without root the test cannot act as a second user: root's directory stands for another
        // user's.
        let refused = RuntimeDir::at("/").ensure().unwrap_err();
        assert!(refused.to_string().contains("belongs to user 0"), "{refused}");
        return;
    }
    let daemon = TestDaemon::start(DAEMON, &[]);
    let permit = |path: &Path, mode| {
        std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    };
    let reachable = tempfile::tempdir().unwrap();
    permit(reachable.path(), 0o755);
    let client = reachable.path().join("fault_client");
    // The copy is made by another process: if this one did, a test that forks meanwhile would keep
    // the file open for writing, and such a file cannot be executed.
    assert!(
        Command::new("cp")
            .args([FAULT_CLIENT.as_ref(), client.as_path()])
            .status()
            .unwrap()
            .success()
    );
    permit(&client, 0o755);
    let record = daemon.path().join("default.daemon");
    // Modes of directory and record by a usual umask, by a strict one, and in between.
    for (dir_mode, record_mode) in [(0o755, 0o644), (0o755, 0o600), (0o700, 0o600)] {
        permit(&record, record_mode);
        permit(daemon.path(), dir_mode);
        let output = Command::new(&client)
            .arg("connect")
            .env("PAIRMASK_RUNTIME_DIR", daemon.path())
            .uid(NOBODY)
            .gid(NOBODY)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(
            said.contains("OtherUser") && said.contains("uid: 0"),
            "{dir_mode:o} {record_mode:o}: {said}"
        );
    }
}

fn umask(process: Pid) -> String {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.as_raw_nonzero()));
    let status = status.expect("a process that lives");
    status.lines().find(|line| line.starts_with("Umask:")).expect("a umask").to_owned()
}

/// The transport changes the umask for each listener: not that of the process that connects.
#[test]
fn sessions_that_connect_at_once_leave_the_umask_alone() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let processes = [getpid(), daemon.worker()];
    let before = processes.map(umask);
    let connected = std::thread::scope(|scope| {
        let connect = || (0..10).filter(|_| daemon.session().connect().is_ok()).count();
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(connect)).collect();
        while threads.iter().any(|thread| !thread.is_finished()) {
            assert_eq!(processes.map(umask), before);
        }
        threads.into_iter().map(|thread| thread.join().unwrap()).sum::<usize>()
    });
    assert_eq!(connected, 40);
    assert_eq!(processes.map(umask), before);
}

#[test]
fn one_client_too_many_is_an_error() {
    let daemon = TestDaemon::start(DAEMON, &["--max-clients", "2"]);
    let connect = || daemon.session().connect();
    let _first = connect().unwrap();
    let second = connect().unwrap();
    assert!(matches!(connect().unwrap_err(), ConnectError::TooManyClients { .. }));
    drop(second);
    let mut third = connect().unwrap();
    check_frame(&mut third, &scene(50, 5));
}

#[test]
fn three_frames_at_a_time_and_no_fourth() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let mut session = daemon.session().connect().unwrap();
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
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let builder = daemon.session().backend(Backend::Auto);
    let mut session = builder.clone().connect().unwrap();
    let boxes = scene(64, 6);
    let held = [(); 3].map(|()| served_by(ServedBy::Daemon, || session.answer(&boxes)));
    for _ in 0..2 {
        assert_eq!(check_frame(&mut session, &boxes), ServedBy::InProcess);
    }
    drop(held);
    comes_back(&mut session, &boxes);
    // This process has no GPU.
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    let mut session = builder.engine(engine).connect().unwrap();
    let _held: Vec<_> = (0..3).map(|_| session.frame(9).unwrap()).collect();
    let is_refused = matches!(session.frame(9), Err(Error::TooManyFrames));
    assert!(is_refused || session.served_by() == ServedBy::InProcess);
}

#[test]
fn a_scene_may_grow_past_its_segment() {
    let daemon = TestDaemon::start(DAEMON, &[]);
    let capacity = BoxCount::new(100);
    let mut session = daemon.session().capacity(capacity).connect().unwrap();
    for n in [10, 100, 500, 3000, 12, 6000] {
        assert_eq!(check_frame(&mut session, &scene(n, 7)), ServedBy::Daemon, "{n} boxes");
    }
}
