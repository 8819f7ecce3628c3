//! Where an instance lives on disk, who serves it, and how a second one is refused.
//!
//! A runtime directory (`/tmp/pairmask-UID` unless told otherwise) holds for each instance a lock
//! file, held by the serving process for its life, and a record that names the process and the
//! wire version. The kernel frees the lock however the process ends.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use rustix::fs::{FlockOperation, flock};

use crate::wire::Version;

/// Name of an instance: 1 to 32 of `a-z 0-9 - _`. It becomes part of file names.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceName(String);

/// Bytes of the longest instance name. Names of shared memory files have a limit of 255 in all.
const MAX_NAME_BYTES: usize = 32;

impl InstanceName {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Default for InstanceName {
    /// `default`: what `serve` and clients use when no name is given.
    fn default() -> Self {
        Self("default".to_owned())
    }
}

impl fmt::Display for InstanceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for InstanceName {
    type Err = InstanceError;

    fn from_str(s: &str) -> Result<Self, InstanceError> {
        let fits = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-' || c == b'_';
        if s.is_empty() || s.len() > MAX_NAME_BYTES || !s.bytes().all(fits) {
            return Err(InstanceError::Name { name: s.to_owned() });
        }
        Ok(Self(s.to_owned()))
    }
}

/// Why an instance's place on disk cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InstanceError {
    /// Not a name.
    #[error("instance name '{name}' is not 1 to 32 of a-z, 0-9, '-' and '_'")]
    Name {
        /// What was given.
        name: String,
    },
    /// Somebody else owns the directory.
    #[error("{} belongs to user {owner}, not to you: set PAIRMASK_RUNTIME_DIR to a directory of your own", path.display())]
    Foreign {
        /// The directory.
        path: PathBuf,
        /// Its owner's user id.
        owner: u32,
    },
    /// A daemon already serves this instance.
    #[error(
        "instance '{name}' is already served by process {pid}: stop it, or serve under another --instance name"
    )]
    AlreadyServed {
        /// The instance.
        name: InstanceName,
        /// Its process, 0 if it has not said yet.
        pid: u32,
    },
    /// The file system said no.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> InstanceError + '_ {
    move |source| InstanceError::Io { path: path.to_owned(), source }
}

/// The directory that holds a user's instances.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RuntimeDir(PathBuf);

fn ensure_own_dir(path: &Path, mode: u32) -> Result<(), InstanceError> {
    fs::DirBuilder::new().recursive(true).mode(mode).create(path).map_err(io_error(path))?;
    let owner = fs::metadata(path).map_err(io_error(path))?.uid();
    if owner != rustix::process::geteuid().as_raw() {
        return Err(InstanceError::Foreign { path: path.to_owned(), owner });
    }
    Ok(())
}

/// Environment variable that names another runtime directory.
const RUNTIME_DIR_VARIABLE: &str = "PAIRMASK_RUNTIME_DIR";
const DEFAULT_PREFIX: &str = "/tmp/pairmask-";

impl RuntimeDir {
    /// `$PAIRMASK_RUNTIME_DIR`, else `/tmp/pairmask-UID`.
    pub fn from_env() -> Self {
        match std::env::var_os(RUNTIME_DIR_VARIABLE) {
            Some(path) if !path.is_empty() => Self(path.into()),
            _ => Self(format!("{DEFAULT_PREFIX}{}", rustix::process::geteuid().as_raw()).into()),
        }
    }

    /// A directory of the caller's choice.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Creates the directory, and refuses one that another user owns: whoever owns it could
    /// swap the files under us.
    ///
    /// # Errors
    /// [`InstanceError::Foreign`], [`InstanceError::Io`].
    pub fn ensure(&self) -> Result<(), InstanceError> {
        ensure_own_dir(&self.0, 0o755)
    }

    /// Instances that have a record, dead or alive, by name.
    pub fn instances(&self) -> Vec<(InstanceName, DaemonRecord)> {
        let Ok(entries) = fs::read_dir(&self.0) else { return Vec::new() };
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

    fn file(&self, name: &InstanceName, suffix: &str) -> PathBuf {
        self.0.join(format!("{name}{suffix}"))
    }

    /// Directory for the transport's own files of this instance. It lies in /tmp whatever the
    /// runtime directory is: it holds sockets, whose paths have 107 bytes at most.
    pub fn transport_root(&self, name: &InstanceName) -> PathBuf {
        format!("/tmp/pairmask-{:012x}", self.hash(name)).into()
    }

    /// Prefix of the instance's files in /dev/shm, which all users and directories share.
    pub fn shm_prefix(&self, name: &InstanceName) -> String {
        format!("pairmask_{:012x}_", self.hash(name))
    }

    /// 48 bits of FNV-1a over directory and name: short, and the same in all processes and builds.
    fn hash(&self, name: &InstanceName) -> u64 {
        // One directory has many spellings.
        let dir = fs::canonicalize(&self.0).unwrap_or_else(|_| self.0.clone());
        let bytes = dir.as_os_str().as_encoded_bytes().iter().chain(b"\0");
        let hash = bytes.chain(name.0.as_bytes()).fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        (hash ^ hash >> 48) & 0xffff_ffff_ffff
    }

    /// Creates the transport's directory, and refuses one that another user owns: the name can be
    /// guessed, and whoever owns it could swap the sockets under us.
    ///
    /// # Errors
    /// [`InstanceError::Foreign`], [`InstanceError::Io`].
    pub fn ensure_transport_root(&self, name: &InstanceName) -> Result<(), InstanceError> {
        ensure_own_dir(&self.transport_root(name), 0o700)
    }

    /// The record of an instance, or `None` where there is none or it cannot be understood.
    pub fn read_record(&self, name: &InstanceName) -> Option<DaemonRecord> {
        let mut text = String::new();
        // A record is three short lines; more is not one of ours.
        File::open(self.file(name, ".daemon")).ok()?.take(256).read_to_string(&mut text).ok()?;
        DaemonRecord::parse(&text)
    }

    /// Whether we may not read the record of an instance: a daemon that was started with a strict
    /// umask keeps even that to its user.
    pub fn is_record_closed(&self, name: &InstanceName) -> bool {
        File::open(self.file(name, ".daemon"))
            .is_err_and(|e| e.kind() == std::io::ErrorKind::PermissionDenied)
    }

    /// Puts the record of an instance in place in one step.
    ///
    /// # Errors
    /// [`InstanceError::Io`].
    pub fn write_record(
        &self,
        name: &InstanceName,
        record: &DaemonRecord,
    ) -> Result<(), InstanceError> {
        let (new, path) = (self.file(name, ".daemon.new"), self.file(name, ".daemon"));
        fs::write(&new, record.to_string()).map_err(io_error(&new))?;
        fs::rename(&new, &path).map_err(io_error(&path))
    }

    /// Removes the record of an instance that stops.
    pub fn remove_record(&self, name: &InstanceName) {
        // Nothing is lost if it stays: readers find that its process is gone.
        let _ = fs::remove_file(self.file(name, ".daemon"));
    }
}

/// Who serves an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DaemonRecord {
    /// Process that answers requests. A new one after a crash.
    pub worker_pid: u32,
    /// Process that was started by the user and watches the worker.
    pub supervisor_pid: u32,
    /// Wire version that it speaks.
    pub version: Version,
}

impl DaemonRecord {
    /// Reads what [`Display`](fmt::Display) writes; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let mut value = |key: &str| lines.next()?.strip_prefix(key)?.strip_prefix('=');
        let (worker, supervisor, version) =
            (value("worker")?, value("supervisor")?, value("wire")?);
        let (major, minor) = version.split_once('.')?;
        Some(Self {
            worker_pid: worker.parse().ok()?,
            supervisor_pid: supervisor.parse().ok()?,
            version: Version { major: major.parse().ok()?, minor: minor.parse().ok()? },
        })
    }
}

impl fmt::Display for DaemonRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { worker_pid, supervisor_pid, version } = self;
        writeln!(f, "worker={worker_pid}\nsupervisor={supervisor_pid}\nwire={version}")
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
        let path = dir.file(name, ".lock");
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(0o644)
            .open(&path)
            .map_err(io_error(&path))?;
        flock(&file, FlockOperation::NonBlockingLockExclusive).map_err(|errno| {
            if errno == rustix::io::Errno::WOULDBLOCK {
                let recorded = dir.read_record(name).map(|r| r.supervisor_pid);
                let pid = recorded.or_else(|| lock_holder(&path)).unwrap_or(0);
                InstanceError::AlreadyServed { name: name.clone(), pid }
            } else {
                io_error(&path)(errno.into())
            }
        })?;
        // For people who look into the directory, and for errors before there is a record.
        let _ = writeln!(file, "{}", std::process::id());
        Ok(Self { _file: file })
    }
}

/// The process that took a lock last, as it wrote itself.
fn lock_holder(path: &Path) -> Option<u32> {
    let mut text = String::new();
    File::open(path).ok()?.take(16).read_to_string(&mut text).ok()?;
    text.lines().next()?.parse().ok()
}

/// Another user who serves an instance of this name under the default directory, if there is one.
pub fn foreign_owner(name: &InstanceName) -> Option<u32> {
    let own = rustix::process::geteuid().as_raw();
    let parent = Path::new(DEFAULT_PREFIX).parent()?;
    fs::read_dir(parent).ok()?.flatten().find_map(|entry| {
        let path = entry.path();
        let owner = entry.metadata().ok()?.uid();
        let is_default = path.to_str()?.starts_with(DEFAULT_PREFIX);
        let record = RuntimeDir::at(&path).read_record(name)?;
        (is_default && owner != own && Path::new(&format!("/proc/{}", record.worker_pid)).exists())
            .then_some(owner)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        for good in ["a", "world", "a-b_9"] {
            assert_eq!(
                good.parse::<InstanceName>().ok().as_ref().map(InstanceName::as_str),
                Some(good)
            );
        }
        for bad in ["", "A", "a/b", "..", "a b", &"x".repeat(33)] {
            assert!(bad.parse::<InstanceName>().is_err(), "{bad}");
        }
    }

    #[test]
    fn records_round_trip_and_junk_is_refused() {
        let record = DaemonRecord {
            worker_pid: 7,
            supervisor_pid: 6,
            version: Version { major: 1, minor: 3 },
        };
        assert_eq!(DaemonRecord::parse(&record.to_string()), Some(record));
        for junk in ["", "worker=1", "worker=x\nsupervisor=2\nwire=1.0", "a=1\nb=2\nc=3"] {
            assert_eq!(DaemonRecord::parse(junk), None, "{junk}");
        }
    }
}
