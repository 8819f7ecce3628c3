//! `clean`: what killed processes left is removed, and nothing else.

use std::fs::{File, FileTimes};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use pairmask::{Backend, Session};
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::Signal;
use serde_json::Value;

use crate::support::{Sandbox, Serving, eventually, keys, names};

/// Files of memory as a process leaves them that is killed while it makes some; removed with the test.
struct Memory {
    files: [PathBuf; 2],
}

impl Memory {
    const BYTES: u64 = 8192;

    /// Of a process of an instance, which made them some time ago.
    fn of(sandbox: &Sandbox, instance: &str, age: Duration) -> Self {
        let name: InstanceName = instance.parse().unwrap();
        let prefix = RuntimeDir::at(sandbox.path()).shm_prefix(&name);
        let files = ["", "segment.data"]
            .map(|name| PathBuf::from(format!("/dev/shm/{prefix}0123456789abcdef_{name}")));
        std::fs::create_dir(&files[0]).unwrap();
        std::fs::write(&files[1], vec![1; Self::BYTES as usize]).unwrap();
        for path in &files {
            let at = FileTimes::new().set_modified(SystemTime::now() - age);
            File::open(path).unwrap().set_times(at).unwrap();
        }
        Self { files }
    }

    fn is_there(&self) -> bool {
        assert_eq!(self.files[0].exists(), self.files[1].exists(), "both or none");
        self.files[0].exists()
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.files[0]);
        let _ = std::fs::remove_file(&self.files[1]);
    }
}

/// All of this user's processes share /dev/shm, which one test cleans at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

const LONG_AGO: Duration = Duration::from_secs(3600);

fn clean(sandbox: &Sandbox, more: &str) -> Value {
    let report = sandbox.run_line(&format!("clean --json {more}")).json();
    assert_eq!(keys(&report), names("dry_run files bytes removed failed"));
    report
}

/// Other tests leave files in shared memory too: only those of this one count.
fn removed(report: &Value, of: &Path) -> Vec<String> {
    let all = report["removed"].as_array().unwrap().iter();
    let paths = all.map(|file| file["path"].as_str().unwrap().to_owned());
    paths.filter(|path| Path::new(path).starts_with(of)).collect()
}

#[test]
fn what_a_killed_daemon_left_is_removed_once() {
    let _alone = alone();
    let sandbox = Sandbox::new();
    drop(Serving::start(&sandbox, "", "default"));
    eventually("the worker ends", || sandbox.processes().is_empty().then_some(()));
    let memory = Memory::of(&sandbox, "default", LONG_AGO);
    let before = sandbox.entries();
    assert!(before.contains("default.daemon") && before.contains("default.socket"), "{before:?}");

    let dry = clean(&sandbox, "--dry-run");
    assert_eq!((sandbox.entries(), memory.is_there()), (before, true), "a dry run");
    let wet = clean(&sandbox, "");
    assert!(!memory.is_there());
    assert_eq!(sandbox.entries(), ["default.lock".to_owned()].into());
    let records = removed(&wet, sandbox.path());
    assert!(records.len() >= 3, "{wet}");
    assert_eq!(records, removed(&dry, sandbox.path()));
    assert!(wet["bytes"].as_u64().unwrap() >= Memory::BYTES, "{wet}");
    assert!(wet["files"].as_u64().unwrap() as usize >= records.len() + memory.files.len(), "{wet}");
    assert!(removed(&clean(&sandbox, ""), sandbox.path()).is_empty());
    let text = sandbox.run_line("clean").stdout;
    assert!(text.starts_with("removed "), "{text}");
}

#[test]
fn what_lives_stays_and_goes_on() {
    let _alone = alone();
    let sandbox = Sandbox::new();
    let serving = Serving::start(&sandbox, "", "default");
    let mut session = serving.session();
    let mut frame = |n| session.frame(n).unwrap().submit().unwrap().wait().unwrap().count();
    assert_eq!(frame(70), 70 * 69 / 2);
    let before = sandbox.entries();
    let memory = Memory::of(&sandbox, "default", LONG_AGO);
    let dead = Memory::of(&sandbox, "dead", LONG_AGO);
    assert!(removed(&clean(&sandbox, ""), sandbox.path()).is_empty());
    assert_eq!(
        (memory.is_there(), dead.is_there()),
        (true, false),
        "of an instance that is served"
    );
    assert_eq!(sandbox.entries(), before);
    assert_eq!(frame(71), 71 * 70 / 2);
    // Also where it is asked from another runtime directory.
    let other = Sandbox::new();
    clean(&other, "");
    assert!(memory.is_there());
    drop(session);
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    clean(&other, "");
    assert!(!memory.is_there(), "nobody serves it any more");
}

#[test]
fn memory_that_is_held_or_new_or_of_another_user_stays() {
    let _alone = alone();
    let sandbox = Sandbox::new();
    let new = Memory::of(&sandbox, "new", Duration::ZERO);
    let held = Memory::of(&sandbox, "held", LONG_AGO);
    let file = File::open(&held.files[1]).unwrap();
    let others = Memory::of(&sandbox, "others", LONG_AGO);
    let is_root = rustix::process::geteuid().is_root();
    for path in others.files.iter().filter(|_| is_root) {
        std::os::unix::fs::chown(path, Some(65_534), None).unwrap();
    }
    clean(&sandbox, "");
    assert!(new.is_there() && held.is_there() && others.is_there() == is_root);
    drop(file);
    clean(&sandbox, "");
    assert!(!held.is_there());
}

#[test]
fn a_daemon_that_starts_meanwhile_is_not_disturbed() {
    let _alone = alone();
    let sandbox = Sandbox::new();
    drop(Serving::start(&sandbox, "", "default"));
    eventually("the worker ends", || sandbox.processes().is_empty().then_some(()));
    let cleaning = std::thread::scope(|scope| {
        let cleaning = scope.spawn(|| (0..20).for_each(|_| drop(clean(&sandbox, ""))));
        let serving = Serving::start(&sandbox, "", "default");
        // The record may still be the one that was left.
        let builder = || {
            let builder = Session::builder().runtime_dir(serving.dir.clone());
            builder.backend(Backend::Daemon)
        };
        let mut session = eventually("the daemon serves", || builder().connect().ok());
        let answered = session.frame(9).unwrap().submit().unwrap().wait().unwrap();
        assert_eq!(answered.count(), 36);
        let done = cleaning.join();
        assert_eq!(sandbox.run_line("status").code, Some(0));
        done
    });
    cleaning.unwrap();
}

#[test]
fn a_directory_that_others_may_change_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let sandbox = Sandbox::new();
    std::fs::set_permissions(sandbox.path(), PermissionsExt::from_mode(0o777)).unwrap();
    let finished = sandbox.run_line("clean");
    assert!(finished.error(1).contains("is open to other users"), "{finished:?}");
}
