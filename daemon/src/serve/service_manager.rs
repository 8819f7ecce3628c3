//! What a daemon reports to the service manager that started it, by the protocol of `sd_notify(3)`: that it serves, that
//! it stops, and now and then that its worker is alive.
//!
//! Each message is a datagram to the socket that `NOTIFY_SOCKET` names, a path or an abstract name. Without the
//! variable nothing is sent. The supervisor sends all of them: the variables are not for its worker.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process::Command;
use std::time::{Duration, Instant};

const SOCKET: &str = "NOTIFY_SOCKET";
/// How long the manager waits for a message before it restarts the service, µs.
const WATCHDOG_US: &str = "WATCHDOG_USEC";
/// The process that it expects these messages of.
const WATCHDOG_PID: &str = "WATCHDOG_PID";

/// Messages in the time of the watchdog: three quarters of it are left for another worker to begin to serve.
const BEATS_A_WATCHDOG: u32 = 4;

#[derive(Debug, Default)]
pub(super) struct ServiceManager {
    socket: Option<(UnixDatagram, SocketAddr)>,
    watchdog: Option<Watchdog>,
    is_ready: bool,
    is_reported: bool,
}

impl ServiceManager {
    /// The manager of this process's environment.
    pub(super) fn from_env() -> Self {
        let Some(name) = crate::path_in(SOCKET) else { return Self::default() };
        match connect(name.as_os_str().as_bytes()) {
            Ok(socket) => {
                let variable = |name| std::env::var(name).ok()?.parse().ok();
                let is_ours = variable(WATCHDOG_PID)
                    .is_none_or(|process: u64| process == u64::from(std::process::id()));
                let time = variable(WATCHDOG_US).filter(|us| is_ours && *us > 0);
                let watchdog = time.map(|us| Watchdog::new(Duration::from_micros(us)));
                Self { socket: Some(socket), watchdog, ..Self::default() }
            }
            Err(error) => {
                log::warn!("the service manager is not notified, {SOCKET}: {error}");
                Self::default()
            }
        }
    }

    /// The worker serves, and its heart has beaten so often.
    pub(super) fn serves(&mut self, beats: Option<u64>, now: Instant) {
        // What finds no room is sent at the next look.
        self.is_ready = self.is_ready || self.send("READY=1");
        if self.watchdog.as_ref().is_some_and(|watchdog| watchdog.is_due(beats, now))
            && self.send("WATCHDOG=1")
            && let Some(watchdog) = &mut self.watchdog
        {
            watchdog.last = beats.map(|beats| (beats, now));
        }
    }

    pub(super) fn stops(&mut self) {
        self.send("STOPPING=1");
    }

    fn send(&mut self, message: &str) -> bool {
        let Some((socket, manager)) = &self.socket else { return true };
        match socket.send_to_addr(message.as_bytes(), manager) {
            Ok(_) => true,
            Err(error) => {
                if !std::mem::replace(&mut self.is_reported, true) {
                    log::warn!("the service manager does not receive '{message}': {error}");
                }
                false
            }
        }
    }
}

/// A process that this one starts reports nothing to its manager.
pub(crate) fn without_manager(command: &mut Command) {
    for variable in [SOCKET, WATCHDOG_US, WATCHDOG_PID] {
        command.env_remove(variable);
    }
}

fn connect(name: &[u8]) -> io::Result<(UnixDatagram, SocketAddr)> {
    use std::ffi::OsStr;
    let manager = match name {
        [b'@', abstract_name @ ..] => SocketAddr::from_abstract_name(abstract_name)?,
        [b'/', ..] => SocketAddr::from_pathname(OsStr::from_bytes(name))?,
        _ => return Err(io::Error::new(io::ErrorKind::InvalidInput, "neither a path nor @NAME")),
    };
    let socket = UnixDatagram::unbound()?;
    // A manager that is busy does not hold up the supervisor.
    socket.set_nonblocking(true)?;
    Ok((socket, manager))
}

/// When the manager is to be sent that the worker is alive.
#[derive(Debug)]
struct Watchdog {
    interval: Duration,
    /// The beats that were there when it was last sent so, and when that was.
    last: Option<(u64, Instant)>,
}

impl Watchdog {
    fn new(time: Duration) -> Self {
        Self { interval: time / BEATS_A_WATCHDOG, last: None }
    }

    /// Beats that stand still say nothing, for how long it may be: the manager decides.
    fn is_due(&self, beats: Option<u64>, now: Instant) -> bool {
        match (beats, self.last) {
            (None, _) => false,
            (Some(_), None) => true,
            (Some(beats), Some((before, at))) => {
                beats != before && now.saturating_duration_since(at) >= self.interval
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn received(socket: &UnixDatagram) -> String {
        let mut bytes = [0; 64];
        let len = socket.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..len].to_vec()).unwrap()
    }

    #[test]
    fn messages_come_by_a_path_and_by_an_abstract_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("notify");
        let name = format!("pairmask-test-{}", std::process::id());
        let by_path = UnixDatagram::bind(&path).unwrap();
        let by_name =
            UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        for (socket, name) in
            [(by_path, path.to_str().unwrap().to_owned()), (by_name, format!("@{name}"))]
        {
            let mut manager = ServiceManager {
                socket: Some(connect(name.as_bytes()).unwrap()),
                watchdog: Some(Watchdog::new(Duration::from_secs(4))),
                ..ServiceManager::default()
            };
            let now = Instant::now();
            manager.serves(None, now);
            manager.serves(Some(1), now);
            manager.serves(Some(2), now);
            manager.serves(Some(3), now + Duration::from_secs(1));
            manager.stops();
            let all: Vec<_> = std::iter::repeat_with(|| received(&socket)).take(4).collect();
            assert_eq!(all, ["READY=1", "WATCHDOG=1", "WATCHDOG=1", "STOPPING=1"], "{name}");
        }
        for name in ["", "notify", "vsock:1:2"] {
            assert!(connect(name.as_bytes()).is_err(), "{name}");
        }
    }

    #[test]
    fn what_is_not_received_is_sent_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("notify");
        let mut manager = ServiceManager {
            socket: Some(connect(path.to_str().unwrap().as_bytes()).unwrap()),
            ..ServiceManager::default()
        };
        manager.serves(None, Instant::now());
        let socket = UnixDatagram::bind(&path).unwrap();
        manager.serves(None, Instant::now());
        assert_eq!(received(&socket), "READY=1");
    }

    #[test]
    fn a_worker_whose_heart_stands_still_is_not_reported_alive() {
        let (start, second) = (Instant::now(), Duration::from_secs(1));
        let mut watchdog = Watchdog::new(8 * second);
        assert!(!watchdog.is_due(None, start));
        assert!(watchdog.is_due(Some(5), start));
        watchdog.last = Some((5, start));
        assert!(!watchdog.is_due(Some(6), start + second), "not yet");
        assert!(watchdog.is_due(Some(6), start + 2 * second));
        assert!(!watchdog.is_due(Some(5), start + 3600 * second), "it stands still");
        assert!(watchdog.is_due(Some(1), start + 2 * second), "another worker's");
    }
}
