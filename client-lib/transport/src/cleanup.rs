//! Removal of files that dead processes left. Only the daemon removes any.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::CallbackProgression;
use iceoryx2::service::ipc;
use pairmask_wire::InstanceName;

use crate::instance::{RuntimeDir, segment_files, shared_files};
use crate::services::{TransportError, config};

/// Removes all files of an instance that no living process uses: before it is served, and after.
/// Call with the instance's lock held and no record in place, so that no client connects meanwhile.
///
/// # Errors
/// [`TransportError`].
pub fn clean_if_abandoned(dir: &RuntimeDir, name: &InstanceName) -> Result<(), TransportError> {
    let config = config(dir, name)?;
    let mut alive = false;
    Node::<ipc::Service>::list(&config, |state| {
        alive |= !matches!(state, NodeState::Dead(_));
        CallbackProgression::Continue
    })
    .map_err(|e| TransportError::new("listing nodes", &e))?;
    if alive {
        return Ok(());
    }
    // A file that cannot be removed does no harm: the services are then taken over instead of
    // created.
    let _ = fs::remove_dir_all(dir.transport_root(name));
    for file in shared_files(&dir.shm_prefix(name)) {
        let _ = fs::remove_file(file.path());
    }
    Ok(())
}

/// A new segment has no length for microseconds. One without length for this long was truncated by
/// its owner.
const HOLLOW_AFTER: Duration = Duration::from_secs(1);

/// Removes files of length 0. The transport waits for such a file without end; a missing file is an
/// error that it handles.
pub fn remove_hollow_files(dir: &RuntimeDir, name: &InstanceName) {
    for file in shared_files(&dir.shm_prefix(name)) {
        let is_hollow = file.metadata().is_ok_and(|data| {
            let age = data.modified().ok().and_then(|at| at.elapsed().ok());
            data.len() == 0 && age.is_some_and(|age| age > HOLLOW_AFTER)
        });
        if is_hollow {
            // Its owner may remove it at the same time: the result is the same.
            let _ = fs::remove_file(file.path());
        }
    }
}

/// The file in shared memory with the messages of a port, if it is there.
pub fn segment_file(dir: &RuntimeDir, name: &InstanceName, port: u128) -> Option<PathBuf> {
    segment_files(&dir.shm_prefix(name), port).next().map(|file| file.path())
}
