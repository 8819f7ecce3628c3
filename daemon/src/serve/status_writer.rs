//! The thread that writes the daemon's status file, and not the one that serves, which looks for requests.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use pairmask_transport::{RuntimeDir, StatusFile};
use pairmask_wire::InstanceName;

use super::{ServeError, StoppedThread, TIDY_INTERVAL};
use crate::locked;

pub(super) struct StatusWriter {
    posted: Arc<Mutex<Option<StatusFile>>>,
    rounds: Arc<AtomicU64>,
    thread: StoppedThread,
}

impl StatusWriter {
    pub(super) fn start(
        dir: &RuntimeDir,
        instance: &InstanceName,
        rounds: Arc<AtomicU64>,
    ) -> Result<Self, ServeError> {
        let posted = Arc::new(Mutex::default());
        let mail = Arc::clone(&posted);
        let (dir, instance) = (dir.clone(), instance.clone());
        let work = move |stop: &AtomicBool| write_until(&dir, &instance, stop, &mail);
        let thread = StoppedThread::start("status", "starting a thread", work)?;
        Ok(Self { posted, rounds, thread })
    }

    /// Has the status file written. A worker thread that does so has come by: it does not hang.
    pub(super) fn post(&self, status: &StatusFile) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
        *locked(&self.posted) = Some(*status);
        self.thread.wake();
    }
}

fn write_until(
    dir: &RuntimeDir,
    instance: &InstanceName,
    stop: &AtomicBool,
    posted: &Mutex<Option<StatusFile>>,
) {
    let mut is_reported = false;
    while !stop.load(Ordering::Relaxed) {
        let status = locked(posted).take();
        if let Some(Err(error)) = status.map(|status| dir.write_status(instance, &status))
            && !std::mem::replace(&mut is_reported, true)
        {
            log::warn!("`pairmaskd status` will not know of this daemon: {error}");
        }
        std::thread::park_timeout(TIDY_INTERVAL);
    }
}
