//! `pairmaskd`, as the tests run it.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use pairmask_tests::command_line::{self, Program};
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::InstanceName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::PrivateDaemon;
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, unlockpt};
use rustix::termios::{Termios, Winsize, tcgetattr, tcsetwinsize};

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

/// A pseudo terminal: what is printed and typed, and the side of the program.
pub fn pty() -> (File, OwnedFd) {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let keyboard = openpt(flags).unwrap();
    grantpt(&keyboard).unwrap();
    unlockpt(&keyboard).unwrap();
    let side = ioctl_tiocgptpeer(&keyboard, flags).unwrap();
    (File::from(keyboard), side)
}

/// A terminal of 80 columns and 24 rows, with what was printed on it.
pub struct Terminal {
    keyboard: File,
    side: OwnedFd,
    printed: Arc<Mutex<Vec<u8>>>,
    reader: JoinHandle<()>,
}

impl Terminal {
    pub fn new() -> Self {
        let (keyboard, side) = pty();
        tcsetwinsize(&side, Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 })
            .unwrap();
        let (mut screen, printed) = (keyboard.try_clone().unwrap(), Arc::default());
        let kept: Arc<Mutex<Vec<u8>>> = Arc::clone(&printed);
        // It ends with an error when nobody has the other side any more.
        let reader = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                kept.lock().unwrap().extend_from_slice(&bytes[..count]);
            }
        });
        Self { keyboard, side, printed, reader }
    }

    /// Runs a command whose stdin and stdout this is, and something with its process. Returns its exit status and stderr.
    pub fn run(&self, mut command: Command, meanwhile: impl FnOnce(u32)) -> (Option<i32>, String) {
        command.stdin(self.side.try_clone().unwrap()).stdout(self.side.try_clone().unwrap());
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        // It has the terminal open too.
        drop(command);
        meanwhile(child.id());
        let status = eventually("the program ends", || child.try_wait().unwrap());
        let mut stderr = String::new();
        child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        (status.code(), stderr)
    }

    pub fn press(&self, keys: &[u8]) {
        (&self.keyboard).write_all(keys).unwrap();
    }

    pub fn printed(&self) -> String {
        String::from_utf8_lossy(&self.printed.lock().unwrap()).into_owned()
    }

    pub fn modes(&self) -> Termios {
        tcgetattr(&self.side).unwrap()
    }

    /// All that was printed. The processes that had the terminal have ended.
    pub fn close(self) -> String {
        let Self { keyboard: _keyboard, side, printed, reader } = self;
        drop(side);
        reader.join().unwrap();
        let printed = printed.lock().unwrap();
        String::from_utf8_lossy(&printed).into_owned()
    }
}
