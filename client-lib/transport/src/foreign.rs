//! Daemons by the kernel's list of sockets, in directories where nobody looks otherwise: other users', for a hint in the
//! error of a client that finds no daemon of its own user. Nothing that is read here is trusted.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use pairmask_wire::InstanceName;

use crate::instance::RuntimeDir;
use crate::runtime_dir::{DEFAULT_PREFIX, USERS_RUN_DIR};

/// Instances whose sockets the kernel lists in this network namespace, each with its directory, of all users. Directories
/// with white space in their names are left out.
pub fn instance_sockets() -> Vec<(RuntimeDir, InstanceName)> {
    let sockets = fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let paths = sockets.lines().filter_map(|line| line.split_ascii_whitespace().nth(7));
    let instance = |path: &str| {
        let (dir, file) = path.rsplit_once('/')?;
        let name = file.strip_suffix(".socket")?.parse().ok()?;
        Some((RuntimeDir::at(dir), name))
    };
    paths.filter_map(instance).collect()
}

/// The id of another user who serves an instance of this name in a default directory, if there is one, also in one
/// that is closed to this user.
pub fn foreign_owner(name: &InstanceName) -> Option<u32> {
    let own = rustix::process::geteuid().as_raw();
    let is_default = |dir: &Path| {
        dir.starts_with(USERS_RUN_DIR)
            || dir.to_str().is_some_and(|dir| dir.starts_with(DEFAULT_PREFIX))
    };
    // The owner of the directory, or of the first one around it that this user may see.
    let owner = |dir: &Path| dir.ancestors().find_map(|dir| Some(dir.metadata().ok()?.uid()));
    let dirs = instance_sockets().into_iter().filter(|(_, served)| served == name);
    let dirs = dirs.filter(|(dir, _)| is_default(dir.path()));
    dirs.filter_map(|(dir, _)| owner(dir.path())).find(|owner| *owner != own)
}
