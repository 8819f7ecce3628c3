//! What processes left that were killed: files of shared memory, and files by which a daemon is found.
//!
//! Memory has a name for about a millisecond, while a process makes it. A name that is there for longer is left, unless
//! its process was stopped in that millisecond: so what a process has open or mapped stays, and all of an instance
//! that is served.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use pairmask_wire::{InstanceError, InstanceName};

use crate::foreign::instance_sockets;
use crate::instance::{FILE_SUFFIXES, InstanceLock, RuntimeDir, SHM_DIR, SHM_PREFIX, shared_files};
use crate::trust::is_own;

/// Names of memory younger than this may be those of a process that makes it now, which another PID namespace may hide:
/// 10,000 times as long as that takes.
const SETTLED_AFTER: Duration = Duration::from_secs(10);

/// Removes the files of an instance's memory that still have a name: those of processes that were killed while they
/// made them, and of a client that makes its memory now, which tries again. To be called before the instance is served.
pub fn remove_left_files(dir: &RuntimeDir, name: &InstanceName) {
    for file in shared_files(&dir.shm_prefix(name)) {
        // What cannot be removed does no harm.
        let _ = remove(&file.path());
    }
}

/// A file or folder of this user that a killed process left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftFile {
    /// Where it is.
    pub path: PathBuf,
    /// Bytes that it takes.
    pub bytes: u64,
    /// The instance that it was found by; `None` for memory.
    of: Option<(RuntimeDir, InstanceName)>,
}

impl LeftFile {
    /// Removes it. Returns whether it did: it stays where its instance has come to be served meanwhile.
    ///
    /// # Errors
    /// The system's.
    pub fn remove(&self) -> io::Result<bool> {
        let _lock = match &self.of {
            None => None,
            // Held meanwhile, so that no daemon starts to use the file.
            Some((dir, name)) => match InstanceLock::acquire(dir, name) {
                Ok(lock) => Some(lock),
                Err(InstanceError::AlreadyServed { .. }) => return Ok(false),
                Err(error) => return Err(io::Error::other(error)),
            },
        };
        match remove(&self.path) {
            // Somebody else did.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            removed => removed.map(|()| true),
        }
    }
}

/// What killed processes of this user left: in shared memory whatever their runtime directory, and of instances of
/// this one.
pub fn left_files(dir: &RuntimeDir) -> Vec<LeftFile> {
    let mut left = left_memory(dir);
    left.extend(dir.all().flat_map(|dir| left_records(&dir)));
    left
}

fn left_memory(dir: &RuntimeDir) -> Vec<LeftFile> {
    let mut groups: BTreeMap<String, Vec<(PathBuf, Metadata)>> = BTreeMap::new();
    for file in shared_files(SHM_PREFIX) {
        if let (Some(name), Ok(data)) = (file.file_name().to_str(), file.metadata())
            && let Some(group) = group_of(name)
            && is_own(&data)
        {
            groups.entry(group.to_owned()).or_default().push((file.path(), data));
        }
    }
    if groups.is_empty() {
        return Vec::new();
    }
    let served = served_prefixes(dir);
    groups.retain(|group, files| {
        let is_served = served.iter().any(|prefix| group.starts_with(prefix.as_str()));
        !is_served && files.iter().all(|(_, data)| is_settled(data))
    });
    // Last, so that nothing begins to be held after the look.
    let held = held_groups();
    groups.retain(|group, _| !held.contains(group));
    let left = |(path, data): (PathBuf, Metadata)| LeftFile {
        bytes: bytes_of(&path, &data),
        path,
        of: None,
    };
    groups.into_values().flatten().map(left).collect()
}

/// What the names of one process's memory have in common: `pairmask_`, its instance and a number of its own. A name that
/// has no such number, as of an earlier version, is one of its instance's group.
fn group_of(name: &str) -> Option<&str> {
    const INSTANCE: usize = SHM_PREFIX.len() + 12 + 1;
    const NUMBER: usize = 16;
    let ends_in_hex = |group: &str, digits: usize| {
        let hex = group.strip_suffix('_').and_then(|rest| rest.get(rest.len() - digits..));
        hex.is_some_and(|hex| hex.bytes().all(|byte| byte.is_ascii_hexdigit()))
    };
    let instance = name.get(..INSTANCE).filter(|instance| ends_in_hex(instance, 12))?;
    let group = name.get(..INSTANCE + NUMBER + 1).filter(|group| ends_in_hex(group, NUMBER));
    Some(group.unwrap_or(instance))
}

/// Prefixes of the memory of instances that are served: those whose sockets the kernel lists, in any directory, and those
/// of these directories, whose daemons may be in another network namespace.
fn served_prefixes(dir: &RuntimeDir) -> Vec<String> {
    let of_dir = |dir: RuntimeDir| {
        let instances = dir.instances().into_iter().map(|(name, _)| name);
        let served = instances.filter(|name| dir.is_served(name) || dir.is_locked(name));
        served.map(|name| dir.shm_prefix(&name)).collect::<Vec<_>>()
    };
    let listed = instance_sockets().into_iter().map(|(dir, name)| dir.shm_prefix(&name));
    listed.chain(dir.all().flat_map(of_dir)).collect()
}

/// A time to come is that of another clock, and says nothing.
fn is_settled(data: &Metadata) -> bool {
    let age = data.modified().ok().and_then(|at| at.elapsed().ok());
    age.is_some_and(|age| age >= SETTLED_AFTER)
}

/// Groups of memory that a process has open or mapped, as far as this one may see.
fn held_groups() -> BTreeSet<String> {
    let mut held = BTreeSet::new();
    let root = format!("{SHM_DIR}/");
    let mut look = |text: &str| {
        let name = text.split_once(&root).map(|(_, name)| name);
        held.extend(name.and_then(group_of).map(str::to_owned));
    };
    for process in fs::read_dir("/proc").into_iter().flatten().flatten() {
        // Those that have ended, and entries that are no processes, have no such files.
        let maps = fs::read(process.path().join("maps")).unwrap_or_default();
        String::from_utf8_lossy(&maps).lines().for_each(&mut look);
        for open in fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten() {
            if let Ok(target) = fs::read_link(open.path()) {
                look(&target.to_string_lossy());
            }
        }
    }
    held
}

fn left_records(dir: &RuntimeDir) -> Vec<LeftFile> {
    // Of a directory that others may change nothing is removed.
    let entries = dir.check().ok().and_then(|()| fs::read_dir(dir.path()).ok());
    let left = entries.into_iter().flatten().flatten().filter_map(|entry| {
        let (file_name, data) = (entry.file_name(), entry.metadata().ok()?);
        let (name, suffix) = file_name.to_str()?.split_once('.')?;
        let name: InstanceName = name.parse().ok()?;
        let is_left = FILE_SUFFIXES.contains(&suffix)
            && !data.is_dir()
            && is_own(&data)
            && !dir.is_served(&name)
            && !dir.is_locked(&name);
        let path = entry.path();
        is_left.then(|| LeftFile {
            bytes: bytes_of(&path, &data),
            path,
            of: Some((dir.clone(), name)),
        })
    });
    let mut left: Vec<LeftFile> = left.collect();
    left.sort_by(|a, b| a.path.cmp(&b.path));
    left
}

/// Bytes that a file takes, or a folder with what is in it.
fn bytes_of(path: &Path, data: &Metadata) -> u64 {
    /// Of which `blocks` counts, whatever the file system.
    const BLOCK_BYTES: u64 = 512;
    let inner = if data.is_dir() { fs::read_dir(path).ok() } else { None };
    let inner = inner.into_iter().flatten().flatten();
    let inner = inner.filter_map(|file| Some(bytes_of(&file.path(), &file.metadata().ok()?)));
    data.blocks() * BLOCK_BYTES + inner.sum::<u64>()
}

fn remove(path: &Path) -> io::Result<()> {
    fs::remove_file(path).or_else(|error| match fs::symlink_metadata(path) {
        Ok(data) if data.is_dir() => fs::remove_dir_all(path),
        _ => Err(error),
    })
}

#[cfg(test)]
mod tests {
    use super::group_of;

    #[test]
    fn names_of_memory_are_grouped_by_the_process_that_made_it() {
        let pool = "pairmask_0123456789ab_0123456789abcdef_";
        assert_eq!(group_of(&format!("{pool}x.data")), Some(pool));
        assert_eq!(group_of(pool), Some(pool));
        let instance = "pairmask_0123456789ab_";
        for earlier in ["node_1", "0123456789abcdeg_", "0123456789abcdef", ""] {
            assert_eq!(group_of(&format!("{instance}{earlier}")), Some(instance), "{earlier}");
        }
        for other in
            ["pairmask_", "pairmask_test", "pairmask_0123456789ag_", "iox2_1", "pairmask_ä"]
        {
            assert_eq!(group_of(other), None, "{other}");
        }
    }
}
