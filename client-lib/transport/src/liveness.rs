//! Whether a daemon lives and runs: a lock that its worker holds, and beats that it counts.
//!
//! Both are one file of the instance, `NAME.heartbeat`, a new one for each worker. The kernel frees the
//! lock however the process ends, and shows it in every PID namespace, where a process id may be
//! another process's or nobody's. Beats carry no time: clocks differ between time namespaces, so a
//! reader looks whether the count moves.

use std::fs::{self, File, OpenOptions};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileExt, OpenOptionsExt, PermissionsExt};
use std::time::{Duration, Instant};

use pairmask_wire::{InstanceError, InstanceName};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::instance::{DaemonRecord, RuntimeDir};
use crate::trust::{check_file, io_error, open_plain};

/// Time between two beats. A reader that misses seven of them takes the daemon for stopped; 50 writes of
/// eight bytes a second take 0.05 % of a core.
pub const BEAT_INTERVAL: Duration = Duration::from_millis(20);
/// A heartbeat that stands still for this long is that of a daemon that does not run: a client that may
/// answers its frame itself then, 200 ms after it was sent at the latest.
pub const SILENT_AFTER: Duration = Duration::from_millis(150);

/// Mode of the file: a user who may open it may lock it, and so keep a dead daemon alive, until another worker makes a
/// file of its own.
const MODE: u32 = 0o600;
/// The same where a group is let in. What a member keeps alive so is silent, by the beats.
const GROUP_MODE: u32 = 0o640;

/// A worker's own heartbeat. Its lock is held until this is dropped or the process ends.
#[derive(Debug)]
pub struct Heartbeat {
    file: File,
    beats: u64,
}

impl Heartbeat {
    /// Begins the heartbeat of an instance, in place of a predecessor's.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn start(dir: &RuntimeDir, name: &InstanceName) -> Result<Self, InstanceError> {
        let (new, path) = (dir.file(name, ".heartbeat.new"), dir.heartbeat_file(name));
        // One that a predecessor left half made: its lock may not be free yet.
        let _ = fs::remove_file(&new);
        let file = open_plain(&new, OpenOptions::new().create_new(true).write(true).mode(MODE))?;
        flock(&file, FlockOperation::NonBlockingLockExclusive)
            .map_err(|errno| io_error(&new)(errno.into()))?;
        if dir.group().is_some() {
            file.set_permissions(fs::Permissions::from_mode(GROUP_MODE)).map_err(io_error(&new))?;
        }
        let mut heart = Self { file, beats: 0 };
        heart.beat().map_err(io_error(&new))?;
        // Locked before it has its name: nobody sees a living worker's file without a lock.
        fs::rename(&new, &path).map_err(io_error(&path))?;
        Ok(heart)
    }

    /// Counts one more beat.
    ///
    /// # Errors
    /// The system's: a full disk, for one.
    pub fn beat(&mut self) -> std::io::Result<()> {
        self.beats += 1;
        self.file.write_all_at(bytemuck::bytes_of(&self.beats), 0)
    }
}

/// Watches the worker that served when the watch began. Another one, after a restart, is not it.
#[derive(Debug)]
pub struct DaemonWatch(Watched);

#[derive(Debug)]
enum Watched {
    Heartbeat(File),
    /// A daemon of an earlier version, which has none.
    Process(ProcessWatch),
}

impl RuntimeDir {
    /// Watches the worker of an instance; `None` where none lives. A daemon of an earlier version has no
    /// heartbeat: then the process of its record is watched, if there is one.
    ///
    /// # Errors
    /// [`InstanceError`] where the heartbeat is not this user's alone.
    pub fn watch(
        &self,
        name: &InstanceName,
        record: Option<&DaemonRecord>,
    ) -> Result<Option<DaemonWatch>, InstanceError> {
        let path = self.heartbeat_file(name);
        let watched = match open_plain(&path, OpenOptions::new().read(true)) {
            Ok(file) => {
                check_file(&path, &file)?;
                Some(Watched::Heartbeat(file))
            }
            Err(InstanceError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::NotFound =>
            {
                let process = record.and_then(|record| ProcessWatch::open(record.worker_pid));
                process.map(Watched::Process)
            }
            Err(error) => return Err(error),
        };
        Ok(watched.map(DaemonWatch).filter(DaemonWatch::is_alive))
    }

    /// Whether a worker of the instance lives, as far as this user may know.
    pub fn is_served(&self, name: &InstanceName) -> bool {
        matches!(self.watch(name, self.read_record(name).as_ref()), Ok(Some(_)))
    }
}

impl DaemonWatch {
    /// Whether the worker lives. A system call of about 0.3 µs: ask at intervals, not in a spin.
    pub fn is_alive(&self) -> bool {
        match &self.0 {
            Watched::Heartbeat(file) => {
                // A shared lock, which other readers may hold too, is available where the worker's has been released.
                // Where the system refuses for another reason, the daemon is asked, and its silence noticed.
                let is_free = flock(file, FlockOperation::NonBlockingLockShared).is_ok();
                if is_free {
                    let _ = flock(file, FlockOperation::Unlock);
                }
                !is_free
            }
            Watched::Process(process) => process.is_alive(),
        }
    }

    /// Beats so far; `None` of a daemon that counts none. A system call, as above.
    pub fn beats(&self) -> Option<u64> {
        let Watched::Heartbeat(file) = &self.0 else { return None };
        let mut beats = [0; 8];
        file.read_exact_at(&mut beats, 0).ok()?;
        Some(u64::from_ne_bytes(beats))
    }
}

/// For how long a heartbeat has stood still, counted in the observer's own looks: one that was itself
/// starved, or suspended with the whole machine, has not looked, and counts no more than one look's time.
#[derive(Clone, Copy, Debug)]
pub struct Stillness {
    beats: Option<u64>,
    looked_at: Instant,
    still: Duration,
    longest_look: Duration,
}

impl Stillness {
    /// A heartbeat as it is seen now. Between two looks `longest_look` passes at most, for all that is
    /// counted.
    pub const fn new(beats: Option<u64>, now: Instant, longest_look: Duration) -> Self {
        Self { beats, looked_at: now, still: Duration::ZERO, longest_look }
    }

    /// Looks again: for how long it has stood still. A daemon that counts no beats never does.
    pub fn look(&mut self, beats: Option<u64>, now: Instant) -> Duration {
        let passed = now.saturating_duration_since(self.looked_at).min(self.longest_look);
        self.looked_at = now;
        if beats.is_none() || beats != self.beats {
            self.beats = beats;
            self.still = Duration::ZERO;
        } else {
            self.still += passed;
        }
        self.still
    }
}

/// Watches one process of this PID namespace through a pidfd, which stays bound to it even if its number
/// is used again.
#[derive(Debug)]
pub struct ProcessWatch {
    pidfd: OwnedFd,
}

impl ProcessWatch {
    /// Opens a pidfd; `None` where no such process lives.
    pub fn open(pid: u32) -> Option<Self> {
        let pid = Pid::from_raw(i32::try_from(pid).ok()?)?;
        let watch = Self { pidfd: pidfd_open(pid, PidfdFlags::empty()).ok()? };
        watch.is_alive().then_some(watch)
    }

    /// Whether the process lives. A system call of about 0.3 µs: ask at intervals, not in a spin.
    pub fn is_alive(&self) -> bool {
        let mut fds = [PollFd::new(&self.pidfd, PollFlags::IN)];
        // A pidfd becomes readable when its process ends. An interrupted poll says nothing.
        !matches!(poll(&mut fds, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })), Ok(1..))
    }
}

/// The name of a process, for messages; `?` where it no longer exists.
pub fn process_name(pid: u32) -> String {
    // A process chooses its name freely, up to 16 bytes: only printable ones are shown.
    let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    let plain: String = name.chars().filter(|c| !c.is_control()).collect();
    if plain.is_empty() { "?".to_owned() } else { plain }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::time::Duration;

    use pairmask_wire::Version;

    use super::*;

    #[test]
    fn sees_a_process_end() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let watch = ProcessWatch::open(child.id()).unwrap();
        assert!(watch.is_alive());
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!watch.is_alive());
        assert!(ProcessWatch::open(0).is_none());
    }

    /// A watch stays with the worker that it began with; process ids play no part.
    #[test]
    fn a_worker_lives_as_long_as_its_lock_is_held() {
        let path = std::env::temp_dir().join(format!("pairmask-heart-{}", std::process::id()));
        let (dir, name) = (RuntimeDir::at(&path), InstanceName::default());
        dir.ensure().unwrap();
        // An id that no process has, and that of one that lives: neither is asked.
        for pid in [u32::MAX >> 1, std::process::id()] {
            let version = Version::CURRENT;
            let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version, fences: 0 };
            let watch = || dir.watch(&name, Some(&record)).unwrap();
            let mut first = Heartbeat::start(&dir, &name).unwrap();
            let (one, other) = (watch().unwrap(), watch().unwrap());
            assert!(one.is_alive() && other.is_alive() && one.is_alive());
            let beats = one.beats().unwrap();
            for beat in 1..3 {
                first.beat().unwrap();
                assert_eq!(one.beats(), Some(beats + beat));
            }
            let second = Heartbeat::start(&dir, &name).unwrap();
            assert!(one.is_alive(), "it is still there");
            let next = watch().unwrap();
            // A process that another test starts holds what is open here until it runs its own program.
            let soon = |is_so: &dyn Fn() -> bool| {
                (0..1_000).any(|_| {
                    std::thread::sleep(Duration::from_millis(1));
                    is_so()
                })
            };
            drop(first);
            assert!(soon(&|| !one.is_alive() && !other.is_alive()) && next.is_alive());
            drop(second);
            assert!(soon(&|| !next.is_alive() && watch().is_none()));
        }
        fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn stillness_is_counted_in_own_looks() {
        let (start, ms) = (Instant::now(), Duration::from_millis);
        let mut heart = Stillness::new(Some(1), start, ms(10));
        assert_eq!(heart.look(Some(1), start + ms(4)), ms(4));
        assert_eq!(heart.look(Some(2), start + ms(8)), ms(0), "it has moved");
        assert_eq!(heart.look(Some(2), start + ms(16)), ms(8));
        let an_hour_later = start + Duration::from_secs(3600);
        assert_eq!(heart.look(Some(2), an_hour_later), ms(18), "nobody looked meanwhile");
        assert_eq!(heart.look(Some(2), an_hour_later + ms(9)), ms(27));
        assert_eq!(heart.look(None, an_hour_later + ms(99)), ms(0));
        assert_eq!(heart.look(None, an_hour_later + ms(199)), ms(0), "it counts no beats");
    }
}
