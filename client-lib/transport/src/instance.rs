//! The files of an instance on disk, the process that serves it, and how a second daemon is
//! refused.
//!
//! A runtime directory ([`RuntimeDir::from_env`]) holds for each instance a lock file, held by the
//! supervisor for its life, a record that names the processes and the wire version, the worker's
//! heartbeat ([`DaemonWatch`](crate::DaemonWatch)), its status file and its [counters](crate::Counters). The kernel frees a lock however
//! its process ends. All of it has to be the user's own, or for a client a user's whom it trusts: both sides refuse
//! files that another user could change, before they open any.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt, chown};
use std::path::{Path, PathBuf};

use pairmask_wire::{InstanceError, InstanceName, Version};
use rustix::fs::{FlockOperation, flock};

use crate::trust::{
    check_directory, check_file, io_error, is_own, open_plain, read_own, replace_own,
};

/// The directory that holds a user's instances.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RuntimeDir {
    path: PathBuf,
    /// Further directories where a client looks.
    others: Vec<PathBuf>,
    /// A group whose members are let in; of a daemon's directory only.
    group: Option<u32>,
}

/// Mode of a directory whose group is let in: its members look at what is in it and change nothing, and files that are
/// made in it are of its group.
const GROUP_MODE: u32 = 0o2750;

/// Creates a directory, or checks that no other user can change the one that exists.
fn ensure_own_dir(path: &Path) -> Result<(), InstanceError> {
    match fs::DirBuilder::new().recursive(true).mode(0o755).create(path) {
        // Something exists at the path: the check below names what is wrong with it.
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(io_error(path)(error)),
        Ok(()) | Err(_) => check_directory(path),
    }?;
    let data = fs::symlink_metadata(path).map_err(io_error(path))?;
    if is_own(&data) {
        Ok(())
    } else {
        Err(InstanceError::Foreign { path: path.to_owned(), owner: data.uid() })
    }
}

/// Creates a directory that is open to a group. One that exists has to be so already: it may hold more than instances.
fn ensure_group_dir(path: &Path, group: u32) -> Result<(), InstanceError> {
    let is_new = fs::symlink_metadata(path).is_err();
    ensure_own_dir(path)?;
    let is_open = |data: &fs::Metadata| data.gid() == group && data.mode() & 0o7777 == GROUP_MODE;
    let open = || {
        if is_new {
            chown(path, None, Some(group))?;
            fs::set_permissions(path, fs::Permissions::from_mode(GROUP_MODE))?;
        }
        fs::symlink_metadata(path)
    };
    match open() {
        Ok(data) if is_open(&data) => Ok(()),
        Ok(_) | Err(_) => Err(InstanceError::NotOfGroup { path: path.to_owned(), group }),
    }
}

/// Where the system keeps shared memory files.
pub(super) const SHM_DIR: &str = "/dev/shm";
/// Begin of the names of all our files there.
pub(super) const SHM_PREFIX: &str = "pairmask_";

/// The files of an instance that is served, behind its name and a dot: those that have a name for good, and those that take
/// their place in one step. Its lock stays when it ends.
pub(super) const FILE_SUFFIXES: [&str; 9] = [
    "daemon",
    "daemon.new",
    "heartbeat",
    "heartbeat.new",
    "account",
    "account.new",
    "counters",
    "counters.new",
    "socket",
];

/// Bytes of a record that are read. A record is four short lines; a longer file is no record.
pub(super) const RECORD_BYTES: u64 = 256;

/// Files in shared memory whose names begin so.
pub(super) fn shared_files(prefix: &str) -> impl Iterator<Item = fs::DirEntry> {
    let is_so = move |file: &fs::DirEntry| {
        file.file_name().as_encoded_bytes().starts_with(prefix.as_bytes())
    };
    fs::read_dir(SHM_DIR).into_iter().flatten().flatten().filter(is_so)
}

impl RuntimeDir {
    /// A directory of the caller's choice.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), others: Vec::new(), group: None }
    }

    /// The first candidate, with the others as further directories for clients.
    pub(super) fn first_of(mut candidates: Vec<PathBuf>) -> Self {
        let others = candidates.split_off(candidates.len().min(1));
        Self { path: candidates.pop().unwrap_or_default(), others, group: None }
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// This directory and the further ones where a client looks, each alone.
    pub fn all(&self) -> impl Iterator<Item = Self> + '_ {
        std::iter::once(&self.path).chain(&self.others).map(Self::at)
    }

    /// The directory where an instance is served: this one, unless a living worker serves it in
    /// another one and none does here.
    #[must_use]
    pub fn serving(&self, name: &InstanceName) -> Self {
        if self.others.is_empty() {
            return self.clone();
        }
        let is_served_in = |dir: &Self| dir.check().is_ok() && dir.is_served(name);
        self.all().find(is_served_in).unwrap_or_else(|| Self::at(&self.path))
    }

    /// Creates the directory. Refuses one that another user owns or may write to: that user could
    /// replace the files in it.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn ensure(&self) -> Result<(), InstanceError> {
        match self.group {
            None => ensure_own_dir(&self.path),
            Some(group) => ensure_group_dir(&self.path, group),
        }
    }

    /// The same directory, of a daemon that lets members of a group in too.
    #[must_use]
    pub fn with_group(self, group: Option<u32>) -> Self {
        Self { group, ..self }
    }

    /// The group whose members are let in.
    pub const fn group(&self) -> Option<u32> {
        self.group
    }

    /// Checks the directory for a client, which creates nothing.
    ///
    /// # Errors
    /// [`InstanceError`], [`InstanceError::Io`] where there is none.
    pub fn check(&self) -> Result<(), InstanceError> {
        check_directory(&self.path)
    }

    /// Instances that have a record, of a living process or not, by name.
    pub fn instances(&self) -> Vec<(InstanceName, DaemonRecord)> {
        let Ok(entries) = fs::read_dir(&self.path) else { return Vec::new() };
        let mut found: Vec<_> = entries
            .flatten()
            .filter_map(|entry| {
                let file_name = entry.file_name();
                let name = file_name.to_str()?.strip_suffix(".daemon")?.parse().ok()?;
                let record = self.read_record(&name)?;
                Some((name, record))
            })
            .collect();
        found.sort_by(|a, b| a.0.cmp(&b.0));
        found
    }

    pub(super) fn file(&self, name: &InstanceName, suffix: &str) -> PathBuf {
        self.path.join(format!("{name}{suffix}"))
    }

    /// Prefix of the instance's files in /dev/shm, which all users and directories share.
    pub fn shm_prefix(&self, name: &InstanceName) -> String {
        format!("{SHM_PREFIX}{:012x}_", self.hash(name))
    }

    /// 48 bits of FNV-1a over directory and name: short, and equal in all processes and builds.
    fn hash(&self, name: &InstanceName) -> u64 {
        // One directory has many paths.
        let dir = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        let bytes = dir.as_os_str().as_encoded_bytes().iter().chain(b"\0");
        let hash = bytes.chain(name.as_str().as_bytes()).fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        (hash ^ hash >> 48) & 0xffff_ffff_ffff
    }

    pub(super) fn socket_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".socket")
    }

    pub(super) fn heartbeat_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".heartbeat")
    }

    pub(super) fn record_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".daemon")
    }

    /// Whether a process has the right to serve an instance, or might have it.
    pub fn is_locked(&self, name: &InstanceName) -> bool {
        match open_plain(&self.file(name, ".lock"), OpenOptions::new().read(true)) {
            Ok(file) => flock(&file, FlockOperation::NonBlockingLockShared).is_err(),
            Err(InstanceError::Io { source, .. }) => source.kind() != ErrorKind::NotFound,
            Err(_) => true,
        }
    }

    /// The record of an instance, or `None` where there is none or it is malformed.
    ///
    /// # Errors
    /// [`InstanceError`] where the file is not this user's alone.
    pub fn record(&self, name: &InstanceName) -> Result<Option<DaemonRecord>, InstanceError> {
        let bytes = read_own(&self.record_file(name), RECORD_BYTES)?;
        Ok(bytes.and_then(|bytes| DaemonRecord::parse(std::str::from_utf8(&bytes).ok()?)))
    }

    /// As [`record`](Self::record), with `None` also for a file that is not this user's alone.
    pub fn read_record(&self, name: &InstanceName) -> Option<DaemonRecord> {
        self.record(name).ok().flatten()
    }

    /// Replaces the record of an instance in one step.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn write_record(
        &self,
        name: &InstanceName,
        record: &DaemonRecord,
    ) -> Result<(), InstanceError> {
        let new = self.file(name, ".daemon.new");
        let text = record.to_string();
        replace_own(&new, &self.record_file(name), text.as_bytes(), self.group.is_some())
    }

    /// Removes the record, the heartbeat, the status file, the counters and the socket of an instance that stops.
    pub fn remove_record(&self, name: &InstanceName) {
        // Files that cannot be removed do no harm: readers find that the lock is free. The record goes
        // first: one without a heartbeat is that of an earlier version.
        for file in [
            self.record_file(name),
            self.heartbeat_file(name),
            self.status_file(name),
            self.file(name, ".counters"),
            self.socket_file(name),
        ] {
            let _ = fs::remove_file(file);
        }
    }
}

/// The processes that serve an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DaemonRecord {
    /// Worker: the process that answers requests. Another one after a crash.
    pub worker_pid: u32,
    /// Supervisor: the process that the user started. It restarts the worker.
    pub supervisor_pid: u32,
    /// Wire version of the daemon.
    pub version: Version,
    /// What holds of the worker's fences, as the daemon numbers it; 0 of an earlier version.
    pub fences: u32,
}

impl DaemonRecord {
    /// Parses the text that [`Display`](fmt::Display) writes; `None` for any other text.
    pub fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let mut value = |key: &str| lines.next()?.strip_prefix(key)?.strip_prefix('=');
        let (worker, supervisor, version) =
            (value("worker")?, value("supervisor")?, value("wire")?);
        let (major, minor) = version.split_once('.')?;
        let fences = value("fences").unwrap_or("0");
        Some(Self {
            worker_pid: worker.parse().ok()?,
            supervisor_pid: supervisor.parse().ok()?,
            version: Version { major: major.parse().ok()?, minor: minor.parse().ok()? },
            fences: fences.parse().ok()?,
        })
    }
}

impl fmt::Display for DaemonRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { worker_pid, supervisor_pid, version, fences } = self;
        writeln!(
            f,
            "worker={worker_pid}\nsupervisor={supervisor_pid}\nwire={version}\nfences={fences}"
        )
    }
}

/// The right to serve an instance, held until dropped or the process ends.
#[derive(Debug)]
pub struct InstanceLock {
    _file: File,
}

impl InstanceLock {
    /// Takes the right to serve `name`.
    ///
    /// # Errors
    /// [`InstanceError::AlreadyServed`] when another process has it; else as [`RuntimeDir::ensure`].
    pub fn acquire(dir: &RuntimeDir, name: &InstanceName) -> Result<Self, InstanceError> {
        dir.ensure()?;
        for other in dir.all().skip(1).filter(|other| other.check().is_ok()) {
            // Clients would find only one of two daemons.
            if let Some(record) = other.read_record(name)
                && other.is_served(name)
            {
                let pid = record.supervisor_pid;
                return Err(InstanceError::AlreadyServed { name: name.clone(), pid });
            }
        }
        let path = dir.file(name, ".lock");
        let mut options = OpenOptions::new();
        let mut file = open_plain(&path, options.create(true).write(true).mode(LOCK_MODE))?;
        check_file(&path, &file)?;
        // A user who may open the file may lock it, and so keep this one from serving.
        file.set_permissions(fs::Permissions::from_mode(LOCK_MODE)).map_err(io_error(&path))?;
        flock(&file, FlockOperation::NonBlockingLockExclusive).map_err(|errno| {
            if errno == rustix::io::Errno::WOULDBLOCK {
                let recorded = dir.read_record(name).map(|r| r.supervisor_pid);
                let pid = recorded.or_else(|| lock_holder(&path)).unwrap_or(0);
                InstanceError::AlreadyServed { name: name.clone(), pid }
            } else {
                io_error(&path)(errno.into())
            }
        })?;
        // The process id is for people, and for errors before there is a record.
        let _ = writeln!(file, "{}", std::process::id());
        Ok(Self { _file: file })
    }
}

/// Mode of the lock: no access for other users.
const LOCK_MODE: u32 = 0o600;

/// Bytes of a lock that are read: the line with a process id.
const HOLDER_BYTES: u64 = 16;

/// The id that the last holder of a lock wrote into it.
fn lock_holder(path: &Path) -> Option<u32> {
    let text = String::from_utf8(read_own(path, HOLDER_BYTES).ok()??).ok()?;
    text.lines().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_round_trip_and_junk_is_refused() {
        let record = DaemonRecord {
            worker_pid: 7,
            supervisor_pid: 6,
            version: Version { major: 1, minor: 3 },
            fences: 0x1121,
        };
        assert_eq!(DaemonRecord::parse(&record.to_string()), Some(record));
        let earlier = DaemonRecord::parse("worker=7\nsupervisor=6\nwire=1.3\n");
        assert_eq!(earlier, Some(DaemonRecord { fences: 0, ..record }));
        for junk in ["", "worker=1", "worker=x\nsupervisor=2\nwire=1.0", "a=1\nb=2\nc=3"] {
            assert_eq!(DaemonRecord::parse(junk), None, "{junk}");
        }
    }
}
