//! A private daemon of a test: it has its own directory, and stops when dropped.

use std::collections::BTreeMap;
use std::fs::DirEntry;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use pairmask::{Backend, ServedBy, Session, SessionBuilder};
use pairmask_core::{EngineChoice, EngineName};
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::{AuditCounts, InstanceName};
use pairmaskd::spawn::is_opening_gpus;
use rustix::process::{Pid, Signal, kill_process};

/// A wait that takes longer than this counts as a hang.
pub const TIMEOUT: Duration = Duration::from_secs(30);

pub fn eventually<T>(what: &str, check: impl FnMut() -> Option<T>) -> T {
    within(TIMEOUT, what, check)
}

pub fn until(what: &str, mut check: impl FnMut() -> bool) {
    eventually(what, || check().then_some(()));
}

/// A program of this package. Cargo builds them before the tests and benches, beside the folder of these.
pub fn program(name: &str) -> PathBuf {
    let here = std::env::current_exe().expect("the path of this program");
    here.ancestors().nth(2).expect("a folder of builds").join(name)
}

/// Has a daemon's supervisor not test it, unless the flag or this process's environment says otherwise: tests count
/// files and segments of a worker, and break workers on purpose.
pub fn without_probe(command: &mut Command) {
    let name = "PAIRMASK_PROBE_MS";
    command.env(name, std::env::var_os(name).unwrap_or("0".into()));
}

/// The daemon's own main.
pub fn pairmaskd() -> PathBuf {
    program("pairmaskd_under_test")
}

/// A daemon without a GPU, and a session of it.
pub fn served() -> (TestDaemon, Session) {
    let daemon = TestDaemon::of_cores();
    let session = daemon.connect();
    (daemon, session)
}

/// As [`served`], with a session that answers by itself where the daemon does not.
pub fn served_or_here() -> (TestDaemon, Session) {
    let daemon = TestDaemon::of_cores();
    let session = daemon.connect_auto();
    (daemon, session)
}

/// Stops a process, and waits until it stands still: on a busy machine its other threads run on for a moment after the
/// signal.
///
/// # Panics
/// If it cannot be stopped.
pub fn stop(pid: Pid) {
    kill_process(pid, Signal::STOP).expect("a process to stop");
    let threads = format!("/proc/{}/task", pid.as_raw_nonzero());
    let is_stopped = |thread: std::io::Result<std::fs::DirEntry>| {
        // The state follows the name, which is in brackets. A thread that has ended runs no more.
        let stat = thread.and_then(|thread| std::fs::read_to_string(thread.path().join("stat")));
        stat.map_or(true, |stat| {
            stat.rsplit_once(") ").is_some_and(|(_, state)| state.starts_with('T'))
        })
    };
    until("all its threads are stopped", || {
        std::fs::read_dir(&threads).is_ok_and(|mut threads| threads.all(is_stopped))
    });
}

/// As [`eventually`], with another limit.
pub(crate) fn within<T>(timeout: Duration, what: &str, mut check: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = check() {
            return value;
        }
        assert!(start.elapsed() < timeout, "waited {timeout:?} in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Submits a thousand frames while the daemon is killed repeatedly, and more until the daemon
/// serves again. `frame` submits frame `i`, checks the answer, and returns what served it.
pub fn outlive_kills(daemon: &mut TestDaemon, mut frame: impl FnMut(usize) -> ServedBy) {
    let (mut here, mut there) = (0, 0);
    for i in 0..1000 {
        match i {
            // In turn, the worker alone is killed, which its supervisor replaces, or the whole
            // daemon, which stays away for a while. The kills come at any time of a frame.
            100 | 501 => daemon.signal_worker(Signal::KILL),
            200 | 601 => daemon.kill(),
            300 | 701 => daemon.restart(),
            _ => {}
        }
        match frame(i) {
            ServedBy::Daemon => there += 1,
            ServedBy::InProcess => here += 1,
        }
    }
    assert!(there > 0 && here >= 200, "{there} by the daemon, {here} in process");
    // Frames of each kind that take turns.
    until("the session comes back to the daemon", || (0..6).all(|i| frame(i) == ServedBy::Daemon));
}

/// An argument of a daemon, with the GPU of the tests in place of the software adapter.
fn of_tests(argument: &str) -> String {
    if argument == "software" { crate::gpu::name() } else { argument.into() }
}

#[derive(Debug)]
pub struct TestDaemon {
    dir: tempfile::TempDir,
    binary: PathBuf,
    arguments: Vec<String>,
    supervisor: Option<Child>,
}

impl TestDaemon {
    /// Starts `serve ARGUMENTS` and waits until it answers. `--gpu software` is the GPU of the tests
    /// ([`gpu`](crate::gpu)).
    pub fn start(arguments: &[&str]) -> Self {
        Self::start_binary(pairmaskd(), arguments)
    }

    pub fn start_binary(binary: PathBuf, arguments: &[&str]) -> Self {
        let mut daemon = Self::idle(binary, arguments);
        daemon.restart();
        daemon
    }

    /// The directory of a daemon that does not run yet.
    pub fn idle(binary: PathBuf, arguments: &[&str]) -> Self {
        Self {
            dir: tempfile::tempdir().expect("a temporary directory"),
            binary,
            arguments: arguments.iter().map(|argument| of_tests(argument)).collect(),
            supervisor: None,
        }
    }

    /// One without a GPU.
    pub fn of_cores() -> Self {
        Self::start(&["--gpu", "none"])
    }

    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.binary);
        command.arg("serve").args(&self.arguments);
        command.env("PAIRMASK_RUNTIME_DIR", self.dir.path()).stdin(Stdio::null());
        without_probe(&mut command);
        command
    }

    /// Starts it and waits for nothing. Returns its supervisor's process id.
    pub fn spawn(&mut self) -> u32 {
        assert!(self.supervisor.is_none(), "the daemon is running");
        let child = self.command().spawn().expect("the daemon's binary runs");
        self.supervisor.insert(child).id()
    }

    /// Serves in another directory, of a group that is let in, and waits until it does.
    pub fn serve_in(&mut self, dir: &Path, group: u32) {
        self.arguments.extend(["--runtime-dir".into(), dir.display().to_string()]);
        self.arguments.push(format!("--allow-group={group}"));
        self.spawn();
        let (dir, name) = (RuntimeDir::at(dir), InstanceName::default());
        eventually("the daemon serves", || dir.read_record(&name));
    }

    pub fn restart(&mut self) {
        let supervisor = self.spawn();
        // The record may still be that of the daemon before, whose worker is just ending.
        let is_own = |record: &DaemonRecord| record.supervisor_pid == supervisor;
        eventually("the daemon serves", || self.record().filter(is_own));
        if self.arguments.iter().any(|argument| argument == "--gpu") {
            self.wait_for_gpus();
        }
    }

    /// Waits until no GPU is being opened any more.
    pub fn wait_for_gpus(&self) {
        until("the GPUs join", || !is_opening_gpus(&self.dir(), &InstanceName::default()));
    }

    pub fn dir(&self) -> RuntimeDir {
        RuntimeDir::at(self.dir.path())
    }

    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    /// A session builder for this daemon. Its deadline is that of a test that hangs: on a busy machine a software GPU
    /// takes longer than a session's own five seconds.
    pub fn session(&self) -> SessionBuilder {
        let builder = Session::builder().runtime_dir(self.dir()).backend(Backend::Daemon);
        builder.deadline(Duration::from_secs(60))
    }

    pub fn connect(&self) -> Session {
        self.session().connect().expect("the daemon answers")
    }

    /// A session that answers by itself where the daemon does not.
    pub fn connect_auto(&self) -> Session {
        self.session().backend(Backend::Auto).connect().expect("any machine has cores")
    }

    /// A session that asks for one engine.
    pub fn connect_to(&self, engine: EngineName) -> Session {
        let builder = self.session().engine(EngineChoice::Only(engine));
        builder.connect().expect("the daemon answers")
    }

    pub fn record(&self) -> Option<DaemonRecord> {
        self.dir().read_record(&InstanceName::default())
    }

    pub fn worker(&self) -> Pid {
        let record = eventually("the daemon has a worker", || self.record());
        Pid::from_raw(i32::try_from(record.worker_pid).expect("a pid")).expect("not zero")
    }

    pub fn audit_is_clean(&self, mut is_enough: impl FnMut(&AuditCounts) -> bool) {
        let mut session = self.connect();
        let audit = eventually("answers are audited", || {
            let audit = session.daemon_status().expect("a status").audit;
            is_enough(&audit).then_some(audit)
        });
        assert_eq!((audit.missed, audit.extra), (0, 0), "{audit:?}");
    }

    /// Sends the worker a signal: the next one, where the one that serves has just died.
    ///
    /// The supervisor is stopped before its worker is, and goes on after it: it would replace the worker.
    pub fn signal_worker(&self, signal: Signal) {
        if signal == Signal::STOP {
            self.signal_supervisor(signal);
        }
        let worker = eventually("a worker lives", || {
            let worker = self.worker();
            kill_process(worker, signal).ok().map(|()| worker)
        });
        if signal == Signal::STOP {
            stop(worker);
        }
        if signal == Signal::CONT {
            self.signal_supervisor(signal);
        }
    }

    fn signal_supervisor(&self, signal: Signal) {
        let supervisor = self.supervisor.as_ref().map(Child::id);
        let pid = supervisor.and_then(|id| Pid::from_raw(i32::try_from(id).ok()?));
        // One that no longer exists needs no signal.
        let _ = pid.map(|pid| kill_process(pid, signal));
    }

    /// Kills the daemon as the system's out-of-memory killer would: the supervisor by SIGKILL, and
    /// the worker with it.
    pub fn kill(&mut self) {
        let mut supervisor = self.supervisor.take().expect("the daemon is running");
        supervisor.kill().expect("SIGKILL");
        supervisor.wait().expect("the supervisor's end");
    }

    /// Asks it to end, if it runs, and kills it where it does not in time.
    pub fn stop(&mut self) {
        // A daemon that has exited already needs no signal.
        self.signal_supervisor(Signal::TERM);
        let Some(mut supervisor) = self.supervisor.take() else { return };
        let start = Instant::now();
        while start.elapsed() < TIMEOUT && matches!(supervisor.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = supervisor.kill();
        let _ = supervisor.wait();
    }

    pub fn shared_bytes(&self) -> u64 {
        // Of 512 bytes, regardless of the file system's blocks.
        self.segments().values().map(|blocks| blocks * 512).sum()
    }

    /// The segments that the worker has, its clients' too: their inodes and blocks. They have no names.
    pub fn segments(&self) -> BTreeMap<u64, u64> {
        use std::os::unix::fs::MetadataExt;
        let prefix = format!("/dev/shm/{}", self.dir().shm_prefix(&InstanceName::default()));
        let files = format!("/proc/{}/fd", self.worker().as_raw_nonzero());
        let is_segment = |file: &DirEntry| {
            let target = std::fs::read_link(file.path());
            target.is_ok_and(|to| to.to_string_lossy().starts_with(&prefix))
        };
        let files = std::fs::read_dir(files).expect("a worker").flatten().filter(is_segment);
        let segments = files.filter_map(|file| std::fs::metadata(file.path()).ok());
        segments.map(|data| (data.ino(), data.blocks())).collect()
    }

    pub fn shared_files(&self) -> Vec<PathBuf> {
        let prefix = self.dir().shm_prefix(&InstanceName::default());
        let mut files: Vec<PathBuf> = std::fs::read_dir("/dev/shm")
            .expect("/dev/shm")
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix))
            .map(|entry| entry.path())
            .collect();
        files.sort();
        files
    }
}

impl Drop for TestDaemon {
    fn drop(&mut self) {
        self.signal_supervisor(Signal::CONT);
        self.stop();
        for file in self.shared_files() {
            // A process without a file to open leaves the directory that it began with.
            let _ = std::fs::remove_file(&file).or_else(|_| std::fs::remove_dir_all(&file));
        }
    }
}
