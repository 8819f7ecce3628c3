//! The log says once that a session falls back, why, and that the daemon answers again; errors name the cause.

use std::sync::{Mutex, Once, PoisonError};
use std::time::Duration;

use log::{Level, LevelFilter, Log, Metadata, Record};
use pairmask_tests::prelude::*;
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::{InstanceName, Version};

fn frame(session: &mut Session) -> ServedBy {
    session.answer(&[Aabb::EMPTY; 2]).info().served_by
}

/// Checks that a session that falls back logs the cause once, and that errors name it, between two
/// attempts too.
fn check(builder: SessionBuilder, cause: fn(&ConnectError) -> bool, text: &str) {
    take_captured();
    let mut session = builder.backend(Backend::Auto).connect().unwrap();
    for _ in 0..20 {
        assert_eq!(frame(&mut session), ServedBy::InProcess, "{text}");
        let error = session.daemon_status().unwrap_err();
        let Error::Connect(error) = error else { panic!("{text}: {error:?}") };
        assert!(cause(&error), "{text}: {error:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    let said = take_captured();
    assert!(said.len() == 1 && said[0].1.contains(text), "{text}: {said:?}");
    assert!(!said[0].1.contains("Backend::Auto"), "it is used already: {said:?}");
}

// One test: a process has only one log.
#[test]
fn the_cause_is_named() {
    let _alone = crate::alone();
    capture(LevelFilter::Info);
    let dir = tempfile::tempdir().unwrap();
    let at = |dir: &RuntimeDir| Session::builder().runtime_dir(dir.clone());
    let empty = RuntimeDir::at(dir.path());
    check(at(&empty), |e| matches!(e, ConnectError::NoDaemon { .. }), "no daemon serves");

    let daemon = TestDaemon::start(&["--gpu", "none", "--max-clients", "1"]);
    let mut first = daemon.session().deadline(Duration::from_millis(200)).connect().unwrap();
    assert_eq!(frame(&mut first), ServedBy::Daemon);
    let is_full = |e: &ConnectError| matches!(e, ConnectError::TooManyClients { .. });
    check(daemon.session(), is_full, "all the clients that it may have");
    drop(first);

    // A daemon that hangs still counts as serving.
    take_captured();
    let deadline = Duration::from_millis(100);
    let mut session = daemon.session().backend(Backend::Auto).deadline(deadline).connect().unwrap();
    assert_eq!(frame(&mut session), ServedBy::Daemon);
    daemon.signal_worker(Signal::STOP);
    assert_eq!(frame(&mut session), ServedBy::InProcess);
    let error = session.daemon_status().unwrap_err();
    daemon.signal_worker(Signal::CONT);
    assert!(matches!(error, Error::Connect(ConnectError::Silent { .. })), "{error:?}");
    is_said_once(Level::Warn, "did not answer in time");

    let name = InstanceName::default();
    let pid = std::process::id();
    let older = Version { minor: Version::CURRENT.minor - 1, ..Version::CURRENT };
    for version in [Version { major: 9, minor: 0 }, older] {
        let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version, fences: 0 };
        empty.write_record(&name, &record).unwrap();
        let is_other = |e: &ConnectError| matches!(e, ConnectError::VersionMismatch { .. });
        check(at(&empty), is_other, &format!("wire version {version}"));
    }
}

/// Checks that the log has one line since the last look.
fn is_said_once(level: Level, text: &str) {
    let said = take_captured();
    assert!(said.len() == 1 && said[0].0 == level && said[0].1.contains(text), "{text}: {said:?}");
}

fn frames(session: &mut Session, count: usize) -> ServedBy {
    (0..count).map(|_| frame(session)).last().unwrap()
}

#[test]
fn falling_back_is_said_once() {
    let _alone = crate::alone();
    capture(LevelFilter::Info);
    let mut daemon = TestDaemon::start(&[]);
    let mut session = daemon.connect_auto();
    assert_eq!(frames(&mut session, 10), ServedBy::Daemon);
    assert_eq!(take_captured(), []);

    daemon.kill();
    assert_eq!(frames(&mut session, 100), ServedBy::InProcess);
    is_said_once(Level::Warn, "answered in process");

    daemon.restart();
    until("the session is back", || frames(&mut session, 1) == ServedBy::Daemon);
    assert_eq!(frames(&mut session, 100), ServedBy::Daemon);
    is_said_once(Level::Info, "answers again");
}

struct CapturedLines(Mutex<Vec<(Level, String)>>);

static CAPTURED: CapturedLines = CapturedLines(Mutex::new(Vec::new()));

impl Log for CapturedLines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target().starts_with("pairmask::")
    }
    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            let line = (record.level(), record.args().to_string());
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    }
    fn flush(&self) {}
}

/// Captures the library's log lines of this level and above from now on, and drops those of before. A process has
/// one log: tests that look at it run one after the other.
pub(crate) fn capture(level: LevelFilter) {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| log::set_logger(&CAPTURED).expect("the process has no other logger"));
    log::set_max_level(level);
    take_captured();
}

/// Takes the lines that were captured since the last call.
pub(crate) fn take_captured() -> Vec<(Level, String)> {
    std::mem::take(&mut CAPTURED.0.lock().unwrap_or_else(PoisonError::into_inner))
}
