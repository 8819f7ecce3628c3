//! A private daemon: a process with a private directory that ends with its owner.
//!
//! For commands, tests and programs that need a daemon for a while and must leave nothing behind.
//! The daemon ends when [`PrivateDaemon`] is dropped, and by itself when its owner dies.

use std::io;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use pairmask::{Backend, ConnectError, Session, SessionBuilder};
use pairmask_transport::{DaemonRecord, GpuCounts, RuntimeDir};
use pairmask_wire::InstanceName;
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use tempfile::TempDir;

use crate::serve::{DaemonSettings, ServeError, ServeSettings, stop, supervise, without_manager};

/// A daemon that does not answer within this time counts as failed: starting takes 50 ms on an idle
/// machine.
const START_WITHIN: Duration = Duration::from_secs(20);
/// A daemon that was asked to stop is killed after this time. Its supervisor gives the worker 5 s.
const STOP_WITHIN: Duration = Duration::from_secs(8);
const LOOK_INTERVAL: Duration = Duration::from_millis(2);
/// Prefix of the private directory's name. Not `pairmask-`, with which the users' default
/// directories begin: those are searched for instances.
pub(crate) const DIR_PREFIX: &str = ".pairmask.";

#[derive(Debug, thiserror::Error)]
pub enum SpawnError {
    #[error("no temporary directory for a daemon: {0} (set TMPDIR to one that can be written)")]
    Dir(#[source] io::Error),
    #[error("starting {}: {source}", binary.display())]
    Start { binary: PathBuf, source: io::Error },
    #[error("the daemon ended before it served ({status}); see its own message")]
    Ended { status: ExitStatus },
    #[error("the daemon does not answer within {START_WITHIN:?}: {source}")]
    Silent { source: Box<ConnectError> },
}

/// A running daemon, stopped when dropped.
///
/// Keep it on the thread that started it, or on one that ends no later: the kernel treats the end
/// of the starting thread as the end of the owner.
#[derive(Debug)]
pub struct PrivateDaemon {
    child: Child,
    dir: TempDir,
}

impl PrivateDaemon {
    /// Waits until the `pairmaskd` at `binary` answers, with the GPUs that there are. After an error
    /// nothing is left running.
    pub fn start(binary: &Path, settings: &DaemonSettings) -> Result<Self, SpawnError> {
        // Messages that it serves or stops say nothing new to its owner.
        Self::start_logging(binary, settings, "warn")
    }

    /// As [`PrivateDaemon::start`], which logs at this level unless the user has named another.
    fn start_logging(
        binary: &Path,
        settings: &DaemonSettings,
        log: &str,
    ) -> Result<Self, SpawnError> {
        let dir = tempfile::Builder::new().prefix(DIR_PREFIX).tempdir().map_err(SpawnError::Dir)?;
        let mut command = Command::new(binary);
        without_manager(&mut command);
        let child = command
            .args(["serve", "--private-to", &std::process::id().to_string()])
            .args(["--instance", InstanceName::default().as_str()])
            .args(settings.flags())
            .arg("--runtime-dir")
            .arg(dir.path())
            .env("PAIRMASK_LOG", std::env::var_os("PAIRMASK_LOG").unwrap_or(log.into()))
            // Only the owner gets a Ctrl-C: a daemon that stops first spoils the owner's last
            // frame.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .map_err(|source| SpawnError::Start { binary: binary.to_owned(), source })?;
        let mut daemon = Self { child, dir };
        let answers = daemon.wait_for(binary, |daemon| daemon.session().connect().map(drop))?;
        answers.map_err(|source| SpawnError::Silent { source: Box::new(source) })?;
        if !settings.gpu.is_none() {
            // One that the user named is there then, or the daemon ends. What takes too long is done without: cores
            // serve.
            let _ = daemon.wait_for(binary, |daemon| {
                let GpuCounts { opening, open } = gpus_of(&daemon.dir(), &daemon.instance());
                let is_settled = opening == 0 && (open > 0 || settings.gpu.is_optional());
                is_settled.then_some(()).ok_or(())
            })?;
        }
        Ok(daemon)
    }

    /// Starts this process's own binary, which is the daemon's on the command line.
    pub(crate) fn start_self(settings: &DaemonSettings) -> Result<Self, SpawnError> {
        Self::start(&Self::own_binary()?, settings)
    }

    /// As [`PrivateDaemon::start_self`], for an owner that kills its worker on purpose: nothing is logged.
    pub(crate) fn start_self_quietly(settings: &DaemonSettings) -> Result<Self, SpawnError> {
        Self::start_logging(&Self::own_binary()?, settings, "off")
    }

    fn own_binary() -> Result<PathBuf, SpawnError> {
        std::env::current_exe()
            .map_err(|source| SpawnError::Start { binary: "/proc/self/exe".into(), source })
    }

    /// Tries something until it is done, as long as a daemon may take to start. Returns how the last try went.
    fn wait_for<E>(
        &mut self,
        binary: &Path,
        attempt: impl Fn(&Self) -> Result<(), E>,
    ) -> Result<Result<(), E>, SpawnError> {
        let deadline = Instant::now() + START_WITHIN;
        let failed = |source| SpawnError::Start { binary: binary.to_owned(), source };
        loop {
            if let Some(status) = self.child.try_wait().map_err(failed)? {
                return Err(SpawnError::Ended { status });
            }
            let done = attempt(self);
            if done.is_ok() || Instant::now() >= deadline {
                return Ok(done);
            }
            std::thread::sleep(LOOK_INTERVAL);
        }
    }

    pub fn dir(&self) -> RuntimeDir {
        RuntimeDir::at(self.dir.path())
    }

    pub fn instance(&self) -> InstanceName {
        InstanceName::default()
    }

    pub fn session(&self) -> SessionBuilder {
        Session::builder()
            .instance(self.instance().as_str())
            .runtime_dir(self.dir())
            .backend(Backend::Daemon)
    }

    pub fn record(&self) -> Option<DaemonRecord> {
        self.dir().read_record(&self.instance())
    }

    /// Asks it to stop. Returns its exit status, or that of a SIGKILL if it did not in time.
    pub fn stop(mut self) -> ExitStatus {
        self.stop_now()
    }

    fn stop_now(&mut self) -> ExitStatus {
        let stopped = stop(&mut self.child, STOP_WITHIN);
        stopped.unwrap_or_else(|_| ExitStatus::from_raw(Signal::KILL.as_raw()))
    }
}

impl Drop for PrivateDaemon {
    fn drop(&mut self) {
        self.stop_now();
    }
}

/// Whether the daemon of an instance is still opening GPUs, by its status file.
pub fn is_opening_gpus(dir: &RuntimeDir, instance: &InstanceName) -> bool {
    gpus_of(dir, instance).opening > 0
}

/// GPUs that the daemon of an instance has open, by its status file.
pub fn open_gpus(dir: &RuntimeDir, instance: &InstanceName) -> u32 {
    gpus_of(dir, instance).open
}

fn gpus_of(dir: &RuntimeDir, instance: &InstanceName) -> GpuCounts {
    let status = dir.read_status(instance).ok().flatten();
    status.map(|status| status.gpus).unwrap_or_default()
}

/// Runs `serve --private-to OWNER`, then removes the runtime directory.
pub(crate) fn serve_private(settings: &ServeSettings, owner: u32) -> Result<(), ServeError> {
    set_parent_process_death_signal(Some(Signal::TERM)).map_err(|errno| ServeError::System {
        step: "binding to the owner",
        source: errno.into(),
    })?;
    // If the owner died before the signal was requested, the signal never comes.
    let is_owned = getppid().is_some_and(|pid| pid.as_raw_nonzero().get().unsigned_abs() == owner);
    let result = if is_owned { supervise(settings) } else { Ok(()) };
    remove_private_dir(settings.dir.path());
    result
}

/// Removes a directory that [`PrivateDaemon::start`] made. Leaves any other path alone.
fn remove_private_dir(path: &Path) {
    let name = path.file_name().and_then(std::ffi::OsStr::to_str).unwrap_or_default();
    if name.starts_with(DIR_PREFIX) {
        // The owner removes it too: the second of the two finds nothing.
        let _ = std::fs::remove_dir_all(path);
    }
}
