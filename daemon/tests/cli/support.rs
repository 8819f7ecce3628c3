//! `pairmaskd`, as the tests run it.

use std::fs::File;
use std::path::Path;
use std::process::Child;

use pairmask_tests::command_line::{self, Program};
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::InstanceName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::PrivateDaemon;
use rustix::process::{Pid, Signal, kill_process};

pub use pairmask_tests::command_line::{Finished, eventually, keys, names};
pub use pairmask_tests::daemon::stop;

pub const PAIRMASKD: &str = env!("CARGO_BIN_EXE_pairmaskd");

pub struct Pairmaskd;

impl Program for Pairmaskd {
    const BINARY: &str = PAIRMASKD;
    const NAME: &str = "pairmaskd";
}

pub type Sandbox = command_line::Sandbox<Pairmaskd>;

/// Waits for the end of a process, and kills it where it hangs.
pub fn finish(child: Child) -> Finished {
    command_line::finish(child, Pairmaskd::NAME)
}

/// A daemon of the test's own.
pub fn daemon() -> PrivateDaemon {
    let settings = DaemonSettings { gpu: GpuChoice::None.into(), ..DaemonSettings::default() };
    PrivateDaemon::start(PAIRMASKD.as_ref(), &settings).unwrap()
}

pub fn run_with(sandbox: &Sandbox, line: &str, variables: &[(&str, &str)]) -> Finished {
    finish(sandbox.line(line).envs(variables.iter().copied()).spawn().unwrap())
}

/// `serve` as a user starts it; killed when dropped.
pub struct Serving {
    child: Option<Child>,
    pub dir: RuntimeDir,
}

impl Serving {
    /// Starts it with the words of a line, and waits until it serves the instance.
    pub fn start(sandbox: &Sandbox, line: &str, instance: &str) -> Self {
        let child = sandbox.line(&format!("serve {line}")).spawn().unwrap();
        Self::of(child, RuntimeDir::at(sandbox.path()), instance)
    }

    pub fn of(child: Child, dir: RuntimeDir, instance: &str) -> Self {
        let serving = Self { child: Some(child), dir };
        let name = instance.parse().unwrap();
        eventually("the daemon serves", || serving.dir.read_record(&name));
        serving
    }

    pub fn record(&self) -> DaemonRecord {
        self.dir.read_record(&InstanceName::default()).unwrap()
    }

    pub fn id(&self) -> u32 {
        self.child.as_ref().unwrap().id()
    }

    pub fn stop(mut self, signal: Signal) -> Finished {
        kill_process(Pid::from_raw(self.id().cast_signed()).unwrap(), signal).unwrap();
        finish(self.child.take().unwrap())
    }

    pub fn session(&self) -> pairmask::Session {
        let builder = pairmask::Session::builder().runtime_dir(self.dir.clone());
        builder.backend(pairmask::Backend::Daemon).connect().unwrap()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// `/dev/full`, on which every write fails.
pub fn full() -> File {
    File::options().write(true).open("/dev/full").unwrap()
}

pub fn words(path: &Path) -> Vec<u32> {
    let bytes = std::fs::read(path).unwrap();
    assert!(bytes.len().is_multiple_of(4), "{} bytes", bytes.len());
    bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}
