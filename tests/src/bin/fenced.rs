//! A process with a worker's fences that tries one thing. `fenced WITHOUT DIR ATTEMPT`: raises the fences of a worker
//! whose runtime directory is `DIR`, without those named, and prints their number. Then a thread that it starts makes
//! the attempt. Ends with 0 where that succeeded, with 1 where it was refused.
//!
//! `unsafe` for system calls that no safe interface has.
#![allow(unsafe_code)]

use std::error::Error;
use std::fs::{self, File};
use std::io::{self, Write};
use std::net::{TcpListener, UdpSocket};
use std::os::fd::AsRawFd;
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::serve::fences::{Refusal, raise};
use pairmaskd::serve::{DaemonSettings, ServeSettings};
use rustix::process::{Resource, getppid, getrlimit, test_kill_process};
use rustix::thread::no_new_privs;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut next = || arguments.next().ok_or("usage: fenced WITHOUT DIR ATTEMPT");
    let (without, dir, attempt) = (next()?, PathBuf::from(next()?), next()?);
    let settings = ServeSettings {
        instance: InstanceName::default(),
        dir: RuntimeDir::at(&dir),
        daemon: DaemonSettings {
            gpu: GpuChoice::None.into(),
            without_fences: without.parse()?,
            ..DaemonSettings::default()
        },
        record: None,
        restarted: false,
        refusal: Refusal::Fails,
        alter_answers: None,
        watch_devices: None,
    };
    println!("{}", raise(&settings).number());
    io::stdout().flush()?;
    let made = std::thread::spawn(move || make(&attempt, &dir));
    match made.join().map_err(|_| "the attempt panicked")? {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error) => {
            eprintln!("{error}");
            Ok(ExitCode::FAILURE)
        }
    }
}

fn make(attempt: &str, dir: &Path) -> io::Result<()> {
    let home = || std::env::var_os("HOME").map(PathBuf::from).unwrap_or_default();
    match attempt {
        "exec" => Err(Command::new("true").exec()),
        "spawn" => Command::new("true").status().map(drop),
        // SAFETY: a child that only ends; the call takes no memory.
        "fork" => match refused_is_error(unsafe {
            libc::syscall(libc::SYS_clone, libc::SIGCHLD, 0, 0, 0, 0)
        })? {
            0 => std::process::exit(0),
            _ => Ok(()),
        },
        // SAFETY: it is given nothing to read. EINVAL, which says so, is the success.
        "clone3" => match refused_is_error(unsafe { libc::syscall(libc::SYS_clone3, 0, 0) }) {
            Err(error) if error.raw_os_error() == Some(libc::EINVAL) => Ok(()),
            result => result.map(drop),
        },
        // SAFETY: no process has this id, and ESRCH, which says so, is the success.
        "ptrace" => match refused_is_error(unsafe { libc::ptrace(libc::PTRACE_CONT, 0, 0, 0) }) {
            Err(error) if error.raw_os_error() == Some(libc::ESRCH) => Ok(()),
            result => result.map(drop),
        },
        // SAFETY: a process with several threads keeps its user namespace. EINVAL, which says so, is the success.
        "unshare" => match refused_is_error(unsafe { libc::unshare(libc::CLONE_NEWUSER) }.into()) {
            Err(error) if error.raw_os_error() == Some(libc::EINVAL) => Ok(()),
            result => result.map(drop),
        },
        "setuid" => {
            // SAFETY: the user stays the same.
            refused_is_error(unsafe { libc::setuid(libc::getuid()) }.into()).map(drop)
        }
        "signal" => {
            test_kill_process(getppid().ok_or(io::ErrorKind::NotFound)?).map_err(Into::into)
        }
        "read-home" => fs::read(home().join("secret")).map(drop),
        "write-home" => File::create(home().join("new")).map(drop),
        "tcp" => TcpListener::bind("127.0.0.1:0").map(drop),
        "udp" => UdpSocket::bind("127.0.0.1:0").map(drop),
        // A service of the user, as the session's bus is.
        "stream" => UnixStream::connect(home().join("service")).map(drop),
        "terminal" => {
            let (file, byte) = (File::open("/dev/null")?, b'x');
            // SAFETY: /dev/null is no terminal: nothing is typed, and ENOTTY is the success.
            let result = unsafe { libc::ioctl(file.as_raw_fd(), libc::TIOCSTI, &raw const byte) };
            match refused_is_error(result.into()) {
                Err(error) if error.raw_os_error() == Some(libc::ENOTTY) => Ok(()),
                result => result.map(drop),
            }
        }
        // What a worker does all the time.
        "serve" => {
            let path = dir.join("port");
            let socket = UnixDatagram::bind(&path)?;
            UnixDatagram::unbound()?.send_to(b"x", &path)?;
            socket.recv(&mut [0])?;
            fs::write(dir.join("a"), "text")?;
            fs::rename(dir.join("a"), dir.join("b"))?;
            fs::remove_file(dir.join("b"))?;
            let segment = format!("/dev/shm/fenced-{}", std::process::id());
            fs::write(&segment, "text")?;
            fs::remove_file(&segment)?;
            fs::read("/proc/self/maps")?;
            fs::read("/etc/passwd").map(drop)
        }
        "core" => match getrlimit(Resource::Core).maximum {
            Some(0) => Err(io::Error::other("no core dumps")),
            _ => Ok(()),
        },
        "new-privs" if no_new_privs()? => Err(io::Error::other("no new privileges")),
        "new-privs" => Ok(()),
        _ => Err(io::Error::other(format!("no attempt is called {attempt}"))),
    }
}

fn refused_is_error(result: libc::c_long) -> io::Result<libc::c_long> {
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(result) }
}
