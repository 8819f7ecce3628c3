//! The thread that takes away what dead clients left, and writes the daemon's status file.
//!
//! A cleanup takes up to 24 ms for a client with 46 MB: too long for the thread that serves.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use pairmask_transport::{
    DaemonNode, JANITOR_INTERVAL, RuntimeDir, Services, StatusFile, remove_hollow_files,
};
use pairmask_wire::InstanceName;

use super::{ServeError, StoppedThread};
use crate::locked;

pub(super) struct Janitor {
    posted: Arc<Mutex<Option<StatusFile>>>,
    segment: Arc<OnceLock<PathBuf>>,
    rounds: Arc<AtomicU64>,
    thread: StoppedThread,
}

impl Janitor {
    pub(super) fn start(
        dir: &RuntimeDir,
        instance: &InstanceName,
        rounds: Arc<AtomicU64>,
    ) -> Result<Self, ServeError> {
        let posted = Arc::new(Mutex::default());
        let mail = Arc::clone(&posted);
        let segment = Arc::new(OnceLock::new());
        let (dir, instance, watched) = (dir.clone(), instance.clone(), Arc::clone(&segment));
        let work = move |stop: &AtomicBool| sweep(&dir, &instance, stop, &mail, &watched);
        let thread = StoppedThread::start("janitor", "starting the janitor", work)?;
        Ok(Self { posted, segment, rounds, thread })
    }

    /// Ends the process where this file, the daemon's segment, is removed.
    pub(super) fn watch_over(&self, segment: PathBuf) {
        // There is one server port.
        let _ = self.segment.set(segment);
    }

    /// Has the status file written, by this thread and not by the one that serves, which looks for requests.
    pub(super) fn post(&self, status: &StatusFile) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
        *locked(&self.posted) = Some(*status);
        self.thread.wake();
    }
}

/// Takes away what dead processes left, and reports how many. What they left is what they wrote:
/// the transport panics over queues that contradict themselves, and those beside them have to go.
pub(super) fn clean_up(node: &DaemonNode) -> u64 {
    let cleaned = catch_unwind(AssertUnwindSafe(|| node.try_cleanup_dead_nodes().cleanups));
    cleaned.unwrap_or_else(|_| {
        log::error!("what a dead client left behind cannot be cleaned up as a whole");
        0
    })
}

fn sweep(
    dir: &RuntimeDir,
    instance: &InstanceName,
    stop: &AtomicBool,
    posted: &Mutex<Option<StatusFile>>,
    segment: &OnceLock<PathBuf>,
) {
    let node = Services::janitor_node(dir, instance)
        .inspect_err(|error| log::error!("dead clients will not be cleaned up: {error}"))
        .ok();
    let mut is_reported = false;
    while !stop.load(Ordering::Relaxed) {
        let status = locked(posted).take();
        if let Some(file) = segment.get()
            && matches!(file.try_exists(), Ok(false))
        {
            // No new client could connect. The supervisor starts another worker, with files of its own.
            log::error!("the files of '{instance}' in /dev/shm were removed: starting anew");
            std::process::abort();
        }
        if let Some(Err(error)) = status.map(|status| dir.write_status(instance, &status))
            && !std::mem::replace(&mut is_reported, true)
        {
            log::warn!("`pairmaskd status` will not know of this daemon: {error}");
        }
        if let Some(node) = &node {
            remove_hollow_files(dir, instance);
            let cleanups = clean_up(node);
            if cleanups > 0 {
                log::info!("cleaned up after {cleanups} dead client(s)");
            }
        }
        std::thread::park_timeout(JANITOR_INTERVAL);
    }
}
