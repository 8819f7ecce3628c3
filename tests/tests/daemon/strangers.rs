//! Files that another user owns or may change: neither side uses them.

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use pairmask_tests::daemon::{pairmaskd, program};
use pairmask_tests::prelude::*;
use pairmask_transport::{InstanceLock, RuntimeDir};
use pairmask_wire::InstanceError::{self, NotPlain, Open};
use pairmask_wire::InstanceName;
use rustix::process::{Pid, kill_process};

const NOBODY: u32 = 65_534;
/// A group that no user of this machine is in.
const GROUP: u32 = 54_321;

/// Checks that [`Backend::Auto`] answers at once in process, regardless of what is wrong with the files.
fn check_auto(daemon: &TestDaemon, what: &str) {
    let start = Instant::now();
    let mask = daemon.connect_auto().answer(&[Aabb::from([0.0; 6]); 2]);
    assert_eq!(mask.info().served_by, ServedBy::InProcess, "{what}");
    assert_eq!(mask.to_vec(), [[0, 1]], "{what}");
    // Not a limit for speed: a stranger's daemon could hold a frame up for the session's deadline.
    assert!(start.elapsed() < Duration::from_secs(5), "{what}: it waited for the stranger");
}

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

fn paths(daemon: &TestDaemon) -> [PathBuf; 3] {
    let file = |name| daemon.path().join(name);
    [daemon.path().to_owned(), file("default.daemon"), file("default.heartbeat")]
}

/// Checks that a client refuses the instance, with such an error, and answers in process where it may.
fn check_refused(daemon: &TestDaemon, path: &Path, is_named: impl Fn(&ConnectError) -> bool) {
    let error = daemon.session().connect().unwrap_err();
    assert!(is_named(&error), "{}: {error}", path.display());
    check_auto(daemon, &path.display().to_string());
}

#[test]
fn what_others_may_write_to_is_not_used_by_a_client() {
    let daemon = TestDaemon::of_cores();
    drop(daemon.connect());
    for path in paths(&daemon) {
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
        drop(daemon.connect());
    }
}

#[test]
fn links_are_not_followed_by_a_client() {
    let daemon = TestDaemon::of_cores();
    for path in paths(&daemon) {
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
        drop(daemon.connect());
    }
}

#[test]
fn what_another_user_owns_is_not_used_by_a_client() {
    if !rustix::process::geteuid().is_root() {
        return not_without_root();
    }
    let daemon = TestDaemon::of_cores();
    let own = [paths(&daemon).to_vec(), vec![daemon.path().join("default.socket")]].concat();
    for path in own {
        chown(&path, Some(NOBODY), None).unwrap();
        check_refused(&daemon, &path, |error| {
            let said = error.to_string();
            said.contains(&format!("belongs to user {NOBODY}"))
                && said.contains("PAIRMASK_RUNTIME_DIR")
        });
        chown(&path, Some(0), None).unwrap();
        drop(daemon.connect());
    }
}

/// Without root the test cannot act as a second user: root's directory stands for another user's.
fn not_without_root() {
    let root = RuntimeDir::at("/");
    let refused = root.check().unwrap_err();
    assert!(matches!(refused, InstanceError::Foreign { owner: 0, .. }), "{refused}");
    let refused = root.ensure().unwrap_err();
    assert!(refused.to_string().contains("belongs to user 0"), "{refused}");
}

#[test]
fn a_daemon_refuses_directories_that_others_may_change() {
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
}

/// Daemon and client were started with different environments, as a service and a shell are.
#[test]
fn a_client_looks_through_all_directories_of_its_user() {
    let own = tempfile::tempdir().unwrap();
    set_mode(own.path(), 0o700);
    let user = rustix::process::geteuid().as_raw();
    let instance = format!("strangers-{}", std::process::id());
    let command = |line: &str, xdg: Option<&Path>| {
        let mut command = Command::new(pairmaskd());
        command.args(line.split(' ')).current_dir(own.path());
        command.env_remove("PAIRMASK_RUNTIME_DIR").env_remove("XDG_RUNTIME_DIR");
        command.env("PAIRMASK_INSTANCE", &instance);
        command.envs(xdg.map(|xdg| ("XDG_RUNTIME_DIR", xdg)));
        command
    };
    let boxes = [at(0.0), at(0.5)];
    fs::write(own.path().join("boxes.f32"), bytemuck::cast_slice(&boxes)).unwrap();
    // In the directory of the login; and where there was none, asked by one that has a login.
    for (of_daemon, dir) in [
        (Some(own.path()), own.path().join("pairmask")),
        (None, PathBuf::from(format!("/tmp/pairmask-{user}"))),
    ] {
        let mut daemon = command("serve --gpu none", of_daemon).spawn().unwrap();
        let record = dir.join(format!("{instance}.daemon"));
        until("the daemon serves", || record.exists());
        let output = |line: &str| command(line, Some(own.path())).output().unwrap();
        let status = output("status --json");
        let culled = output("cull boxes.f32 --backend daemon");
        let refused = output("serve --gpu none");
        kill_process(Pid::from_raw(daemon.id() as i32).unwrap(), Signal::TERM).unwrap();
        daemon.wait().unwrap();
        let _ = fs::remove_file(dir.join(format!("{instance}.lock")));
        assert!(status.status.success(), "{status:?}");
        assert!(culled.status.success(), "{}: {culled:?}", dir.display());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(said.contains("already served"), "{}: {said}", dir.display());
    }
}

/// A copy of the client that other users may run, and the directory that it lies in.
fn open_client() -> (tempfile::TempDir, PathBuf) {
    let reachable = tempfile::tempdir().unwrap();
    set_mode(reachable.path(), 0o755);
    let client = reachable.path().join("fault_client");
    // The copy is made by another process: if this one did, a test that forks meanwhile would keep
    // the file open for writing, and such a file cannot be executed.
    let copied = Command::new("cp").args([program("fault_client"), client.clone()]).status();
    assert!(copied.unwrap().success());
    set_mode(&client, 0o755);
    (reachable, client)
}

fn own_group() -> u32 {
    rustix::process::getegid().as_raw()
}

/// Modes of what members of a group may look at, and that nobody else may.
#[test]
fn a_group_that_is_let_in_may_look_and_change_nothing() {
    let group = own_group();
    let mut daemon = TestDaemon::idle(pairmaskd(), &["--gpu", "none"]);
    let dir = daemon.path().join("shared");
    daemon.serve_in(&dir, group);
    let file = |name| dir.join(name);
    until("it gives an account of itself", || file("default.account").exists());
    for (path, mode) in [
        (dir.clone(), 0o2750),
        (file("default.daemon"), 0o640),
        (file("default.heartbeat"), 0o640),
        (file("default.account"), 0o640),
        (file("default.counters"), 0o640),
        (file("default.socket"), 0o660),
        (file("default.lock"), 0o600),
    ] {
        let data = fs::metadata(&path).unwrap();
        assert_eq!((data.mode() & 0o7777, data.gid()), (mode, group), "{}", path.display());
    }
    let session = Session::builder().runtime_dir(&dir).backend(Backend::Daemon);
    assert_eq!(session.connect().unwrap().answer(&[at(0.0); 2]).to_vec(), [[0, 1]]);
    daemon.stop();
    // A directory that is there is not opened to anybody.
    for mode in [0o755, 0o700, 0o750, 0o2755] {
        set_mode(&dir, mode);
        let refused = RuntimeDir::at(&dir).with_group(Some(group)).ensure();
        assert!(matches!(refused, Err(InstanceError::NotOfGroup { .. })), "{mode:o}");
        assert_eq!(fs::metadata(&dir).unwrap().mode() & 0o7777, mode);
    }
}

/// A member of a group that is let in, who trusts the daemon's user, is served; nobody else is.
#[test]
fn another_user_is_let_in_by_its_group_where_it_trusts_the_daemons_user() {
    if !rustix::process::geteuid().is_root() {
        // No second user, and no group that this one is not in.
        let dir = tempfile::tempdir().unwrap();
        let (path, group) = (dir.path().join("new"), Some(0));
        let refused = RuntimeDir::at(&path).with_group(group).ensure();
        let is_member = own_group() == 0;
        let is_refused = matches!(refused, Err(InstanceError::NotOfGroup { group: 0, .. }));
        assert!(is_member || is_refused, "{refused:?}");
        return not_without_root();
    }
    let (_reachable, client) = open_client();
    let mut daemon = TestDaemon::idle(pairmaskd(), &["--gpu", "none"]);
    set_mode(daemon.path(), 0o755);
    let dir = daemon.path().join("shared");
    daemon.serve_in(&dir, GROUP);
    let connect = |groups: &str, trusted: &str| {
        let output = Command::new("setpriv")
            .args(["--reuid", &NOBODY.to_string(), "--regid", &NOBODY.to_string(), groups])
            .arg(&client)
            .arg("connect")
            .env("PAIRMASK_RUNTIME_DIR", &dir)
            .env("PAIRMASK_TRUST_UID", trusted)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let many: Vec<String> = (100_000..100_090).map(|group: u32| group.to_string()).collect();
    let (member, of_many) =
        (format!("--groups={GROUP}"), format!("--groups={},{GROUP}", many.join(",")));
    assert_eq!(connect(&member, "0"), "connected\n");
    assert_eq!(connect(&of_many, "0"), "connected\n");
    for (groups, trusted) in [(&*member, ""), (&*member, "7"), (&*member, "root")] {
        let said = connect(groups, trusted);
        assert!(said.contains("OtherUser") && said.contains("uid: 0"), "{trusted}: {said}");
    }
    for groups in ["--clear-groups", "--groups=54322"] {
        let said = connect(groups, "0");
        assert!(said.contains("PermissionDenied"), "{groups}: {said}");
        // Also where modes keep nobody out: the socket is closed at once.
        let files =
            ["default.daemon", "default.heartbeat", "default.socket"].map(|name| dir.join(name));
        set_mode(&dir, 0o755);
        for file in &files {
            set_mode(file, 0o644);
        }
        set_mode(&files[2], 0o777);
        let said = connect(groups, "0");
        assert!(!said.contains("connected"), "{groups}: {said}");
        set_mode(&dir, 0o2750);
    }
    assert_eq!(connect(&member, "0"), "connected\n");
}

/// A user cannot let a group in that it is not in itself.
#[test]
fn a_foreign_group_is_refused() {
    if !rustix::process::geteuid().is_root() {
        return not_without_root();
    }
    let (reachable, _) = open_client();
    let own = reachable.path().join("own");
    fs::create_dir(&own).unwrap();
    chown(&own, Some(NOBODY), Some(NOBODY)).unwrap();
    let binary = reachable.path().join("pairmaskd");
    assert!(Command::new("cp").args([pairmaskd(), binary.clone()]).status().unwrap().success());
    let output = Command::new(&binary)
        .args(["serve", "--gpu", "none", "--allow-group", "54321", "--config", "/dev/null"])
        .arg("--runtime-dir")
        .arg(own.join("new"))
        .uid(NOBODY)
        .gid(NOBODY)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("not open to group 54321"), "{said}");
}

#[test]
fn another_users_daemon_is_named() {
    if !rustix::process::geteuid().is_root() {
        return not_without_root();
    }
    let daemon = TestDaemon::start(&[]);
    let (_reachable, client) = open_client();
    let record = daemon.path().join("default.daemon");
    // Modes of directory and record by a usual umask, by a strict one, and in between.
    for (dir_mode, record_mode) in [(0o755, 0o644), (0o755, 0o600), (0o700, 0o600)] {
        set_mode(&record, record_mode);
        set_mode(daemon.path(), dir_mode);
        let output = Command::new(&client)
            .arg("connect")
            .env("PAIRMASK_RUNTIME_DIR", daemon.path())
            .uid(NOBODY)
            .gid(NOBODY)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        let is_named = said.contains("OtherUser") && said.contains("uid: 0");
        assert!(is_named, "{dir_mode:o} {record_mode:o}: {said}");
    }
}
