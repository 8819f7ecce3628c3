//! Other users' daemons: a hint in the error of a client that finds no daemon of its own user.
//! Nothing that is read here is trusted.

use std::fs::{self, File, OpenOptions};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use pairmask_wire::InstanceName;

use crate::instance::{DaemonRecord, RECORD_BYTES, RuntimeDir};
use crate::runtime_dir::{DEFAULT_PREFIX, USERS_RUN_DIR};
use crate::trust::open_plain;

/// The id of another user who serves an instance of this name in a default directory, if there is
/// one.
pub fn foreign_owner(name: &InstanceName) -> Option<u32> {
    let own = rustix::process::geteuid().as_raw();
    in_tmp(name, own).or_else(|| in_run(name, own))
}

fn in_tmp(name: &InstanceName, own: u32) -> Option<u32> {
    let parent = Path::new(DEFAULT_PREFIX).parent()?;
    fs::read_dir(parent).ok()?.flatten().find_map(|entry| {
        let path = entry.path();
        let owner = entry.metadata().ok()?.uid();
        if owner == own || !path.to_str()?.starts_with(DEFAULT_PREFIX) {
            return None;
        }
        let file: File =
            open_plain(&RuntimeDir::at(&path).record_file(name), OpenOptions::new().read(true))
                .ok()?;
        if !file.metadata().ok()?.is_file() {
            return None;
        }
        let mut text = String::new();
        file.take(RECORD_BYTES).read_to_string(&mut text).ok()?;
        let record = DaemonRecord::parse(&text)?;
        Path::new(&format!("/proc/{}", record.worker_pid)).exists().then_some(owner)
    })
}

/// Looks for the transport's directory of another user's daemon. The user's run directory itself is
/// closed to this user; the transport's directory has a known path in /tmp and is visible.
fn in_run(name: &InstanceName, own: u32) -> Option<u32> {
    fs::read_dir(USERS_RUN_DIR).ok()?.flatten().find_map(|entry| {
        let user: u32 = entry.file_name().to_str()?.parse().ok()?;
        let root = RuntimeDir::of_user_run_dir(&entry.path()).transport_root(name);
        let data = fs::symlink_metadata(root).ok()?;
        (user != own && data.is_dir() && data.uid() == user).then_some(user)
    })
}
