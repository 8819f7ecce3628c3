//! Other users' daemons: a hint in the error of a client that finds no daemon of its own user.
//! Nothing that is read here is trusted.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use pairmask_wire::InstanceName;

use crate::runtime_dir::{DEFAULT_PREFIX, USERS_RUN_DIR};

/// The id of another user who serves an instance of this name in a default directory, if there is
/// one: by the kernel's list of sockets, which names also those in directories that are closed to this user.
pub fn foreign_owner(name: &InstanceName) -> Option<u32> {
    let own = rustix::process::geteuid().as_raw();
    let sockets = fs::read_to_string("/proc/net/unix").ok()?;
    let file = format!("{name}.socket");
    let paths = sockets.lines().filter_map(|line| line.split_ascii_whitespace().nth(7));
    let is_default = |path: &&Path| {
        path.ends_with(&file)
            && (path.starts_with(USERS_RUN_DIR)
                || path.to_str().is_some_and(|path| path.starts_with(DEFAULT_PREFIX)))
    };
    // The owner of the directory, or of the first one around it that this user may see.
    let owner =
        |path: &Path| path.ancestors().skip(1).find_map(|dir| Some(dir.metadata().ok()?.uid()));
    paths.map(Path::new).filter(is_default).filter_map(owner).find(|owner| *owner != own)
}
