//! Removal of files that dead processes left.

use std::fs;

use pairmask_wire::InstanceName;

use crate::instance::{RuntimeDir, shared_files};

/// Removes the files of an instance's memory that still have a name: those of processes that were killed while they
/// made them, and of a client that makes its memory now, which tries again. To be called before the instance is served.
pub fn remove_left_files(dir: &RuntimeDir, name: &InstanceName) {
    for file in shared_files(&dir.shm_prefix(name)) {
        // What cannot be removed does no harm.
        let path = file.path();
        let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path));
    }
}
