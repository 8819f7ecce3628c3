//! Files that another user owns or may change: neither side uses them.

use pairmask_tests::prelude::*;
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use pairmask_transport::{InstanceLock, RuntimeDir};
use pairmask_wire::InstanceError::{self, NotPlain, Open};
use pairmask_wire::InstanceName;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

/// Id of a user other than the tests' own.
const NOBODY: u32 = 65_534;

fn connect(daemon: &TestDaemon) -> Result<Session, ConnectError> {
    daemon.session().connect()
}

/// Checks that [`Backend::Auto`] answers at once in process, whatever is wrong with the files.
fn check_auto(daemon: &TestDaemon, what: &str) {
    let start = Instant::now();
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    let mask = session.answer(&[Aabb::from([0.0; 6]); 2]);
    assert_eq!(mask.info().served_by, ServedBy::InProcess, "{what}");
    assert_eq!(mask.to_vec(), [[0, 1]], "{what}");
    // Not a limit for speed: a stranger's daemon could hold a frame up for the session's deadline.
    assert!(start.elapsed() < Duration::from_secs(5), "{what}: it waited for the stranger");
}

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

fn places(daemon: &TestDaemon) -> [PathBuf; 4] {
    let name = InstanceName::default();
    let root = daemon.dir().transport_root(&name);
    let file = |name| daemon.path().join(name);
    [daemon.path().to_owned(), file("default.daemon"), file("default.heartbeat"), root]
}

/// Checks that a client refuses the instance, with such an error, and answers in process where it may.
fn check_refused(daemon: &TestDaemon, path: &Path, is_named: impl Fn(&ConnectError) -> bool) {
    let error = connect(daemon).unwrap_err();
    assert!(is_named(&error), "{}: {error}", path.display());
    check_auto(daemon, &path.display().to_string());
}

#[test]
fn what_others_may_write_to_is_not_used_by_a_client() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    drop(connect(&daemon).unwrap());
    for path in places(&daemon) {
        let mode = fs::metadata(&path).unwrap().mode() & 0o7777;
        for open in [0o020, 0o002] {
            set_mode(&path, mode | open);
            check_refused(
                &daemon,
                &path,
                |error| matches!(error, ConnectError::Instance(Open { path: p, .. }) if *p == path),
            );
        }
        set_mode(&path, mode);
        drop(connect(&daemon).unwrap());
    }
}

#[test]
fn links_are_not_followed_by_a_client() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    for path in places(&daemon) {
        // Beside it, so that a directory with others' links in it is moved as a whole.
        let moved = path.with_extension("moved");
        fs::rename(&path, &moved).unwrap();
        symlink(&moved, &path).unwrap();
        check_refused(
            &daemon,
            &path,
            |error| matches!(error, ConnectError::Instance(NotPlain { path: p, .. }) if *p == path),
        );
        fs::remove_file(&path).unwrap();
        fs::rename(&moved, &path).unwrap();
        drop(connect(&daemon).unwrap());
    }
}

#[test]
fn what_another_user_owns_is_not_used_by_a_client() {
    if !rustix::process::geteuid().is_root() {
        return not_without_root();
    }
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let shared = daemon.shared_files();
    let own = [places(&daemon).to_vec(), vec![shared[0].clone()]].concat();
    for path in own {
        chown(&path, Some(NOBODY), None).unwrap();
        check_refused(&daemon, &path, |error| {
            let said = error.to_string();
            said.contains(&format!("belongs to user {NOBODY}"))
                && said.contains("PAIRMASK_RUNTIME_DIR")
        });
        chown(&path, Some(0), None).unwrap();
        drop(connect(&daemon).unwrap());
    }
}

/// Another user's file in shared memory with a name of this user's instance: a client could map it.
#[test]
fn a_strangers_file_in_shared_memory_keeps_clients_and_daemons_away() {
    if !rustix::process::geteuid().is_root() {
        return not_without_root();
    }
    let mut daemon = TestDaemon::start(DAEMON, &["--gpu", "none"]);
    let name = format!("{}stranger", daemon.dir().shm_prefix(&InstanceName::default()));
    let file = Path::new("/dev/shm").join(name);
    fs::write(&file, "x").unwrap();
    chown(&file, Some(NOBODY), None).unwrap();
    check_refused(&daemon, &file, |error| {
        matches!(error, ConnectError::Instance(InstanceError::Foreign { owner: NOBODY, .. }))
    });
    fs::remove_file(&file).unwrap();
    drop(connect(&daemon).unwrap());
    daemon.kill();
}

/// Without root the test cannot act as a second user: root's directory stands for another user's.
fn not_without_root() {
    let refused = RuntimeDir::at("/").check().unwrap_err();
    assert!(matches!(refused, InstanceError::Foreign { owner: 0, .. }), "{refused}");
}

#[test]
fn a_daemon_refuses_places_that_others_may_change() {
    let name = InstanceName::default();
    let acquire = |path: &Path| InstanceLock::acquire(&RuntimeDir::at(path), &name);
    // A daemon that another test starts holds what this process holds until it runs its own program.
    let acquired = |path: &Path| {
        eventually("nobody holds the lock", || match acquire(path) {
            Err(InstanceError::AlreadyServed { .. }) => None,
            result => Some(result.unwrap()),
        })
    };
    let parent = tempfile::tempdir().unwrap();
    let dir = parent.path().join("dir");
    drop(acquired(&dir));
    let lock = dir.join("default.lock");
    assert_eq!(fs::metadata(&lock).unwrap().mode() & 0o7777, 0o600);
    // The lock of an earlier version, which every user could open, and so hold.
    set_mode(&lock, 0o644);
    drop(acquired(&dir));
    assert_eq!(fs::metadata(&lock).unwrap().mode() & 0o7777, 0o600);

    set_mode(&lock, 0o622);
    assert!(matches!(acquire(&dir), Err(InstanceError::Open { .. })));
    fs::remove_file(&lock).unwrap();
    let elsewhere = parent.path().join("elsewhere");
    symlink(&elsewhere, &lock).unwrap();
    assert!(matches!(acquire(&dir), Err(InstanceError::NotPlain { .. })));
    assert!(!elsewhere.exists(), "the link was followed");
    fs::remove_file(&lock).unwrap();

    for mode in [0o777, 0o775, 0o1777] {
        set_mode(&dir, mode);
        assert!(matches!(acquire(&dir), Err(InstanceError::Open { .. })), "{mode:o}");
    }
    set_mode(&dir, 0o755);
    let link = parent.path().join("link");
    symlink(&dir, &link).unwrap();
    assert!(matches!(acquire(&link), Err(InstanceError::NotPlain { .. })));

    let root = RuntimeDir::at(&dir).transport_root(&name);
    fs::create_dir(&root).unwrap();
    set_mode(&root, 0o750);
    let refused = RuntimeDir::at(&dir).ensure_transport_root(&name);
    fs::remove_dir(&root).unwrap();
    assert!(matches!(refused, Err(InstanceError::Open { .. })), "{refused:?}");
}

/// Daemon and client were started with different environments, as a service and a shell are.
#[test]
fn a_client_looks_through_all_directories_of_its_user() {
    let own = tempfile::tempdir().unwrap();
    set_mode(own.path(), 0o700);
    let user = rustix::process::geteuid().as_raw();
    let instance = format!("strangers-{}", std::process::id());
    let run = |command: &mut Command, xdg: Option<&Path>| {
        command.env_remove("PAIRMASK_RUNTIME_DIR").env_remove("XDG_RUNTIME_DIR");
        command.env("PAIRMASK_INSTANCE", &instance);
        if let Some(xdg) = xdg {
            command.env("XDG_RUNTIME_DIR", xdg);
        }
    };
    let scene = own.path().join("boxes.f32");
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]), Aabb::new([0.5; 3], [2.0; 3])];
    fs::write(&scene, bytemuck::cast_slice(&boxes)).unwrap();
    // In the directory of the login; and where there was none, asked by one that has a login.
    for (of_daemon, at) in [
        (Some(own.path()), own.path().join("pairmask")),
        (None, PathBuf::from(format!("/tmp/pairmask-{user}"))),
    ] {
        let mut serve = Command::new(DAEMON);
        run(serve.args(["serve", "--gpu", "none"]), of_daemon);
        let mut daemon = serve.spawn().unwrap();
        let record = at.join(format!("{instance}.daemon"));
        eventually("the daemon serves", || record.exists().then_some(()));
        let mut status = Command::new(DAEMON);
        run(status.args(["status", "--json"]), Some(own.path()));
        let output = status.output().unwrap();
        let mut cull = Command::new(DAEMON);
        run(cull.arg("cull").arg(&scene).args(["--backend", "daemon"]), Some(own.path()));
        let culled = cull.output().unwrap();
        let mut second = Command::new(DAEMON);
        run(second.args(["serve", "--gpu", "none"]), Some(own.path()));
        let refused = second.output().unwrap();
        let pid = rustix::process::Pid::from_raw(daemon.id() as i32).unwrap();
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        daemon.wait().unwrap();
        let _ = fs::remove_file(at.join(format!("{instance}.lock")));
        assert!(output.status.success(), "{output:?}");
        assert!(culled.status.success(), "{}: {culled:?}", at.display());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(said.contains("already served"), "{}: {said}", at.display());
    }
}
