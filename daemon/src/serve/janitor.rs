//! The thread that takes away what dead clients left.
//!
//! A cleanup takes up to 24 ms for a client with 46 MB: too long for the thread that serves.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use pairmask::transport::{
    DaemonNode, InstanceName, JANITOR_INTERVAL, RuntimeDir, Services, remove_hollow_files,
};

use super::ServeError;

/// Stops and joins its thread when dropped.
pub(super) struct Janitor {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Janitor {
    pub(super) fn start(dir: &RuntimeDir, instance: &InstanceName) -> Result<Self, ServeError> {
        let stop = Arc::new(AtomicBool::new(false));
        let (told, dir, instance) = (Arc::clone(&stop), dir.clone(), instance.clone());
        let thread = std::thread::Builder::new()
            .name("janitor".into())
            .spawn(move || sweep(&dir, &instance, &told))
            .map_err(ServeError::system("starting the janitor"))?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for Janitor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A janitor that panicked has nothing left to tell.
            let _ = thread.join();
        }
    }
}

/// Takes away what dead processes left, and tells of how many. What they left is whatever they wrote:
/// the transport panics over queues that contradict themselves, and those beside them have to go.
pub(super) fn clean_up(node: &DaemonNode) -> u64 {
    let cleaned = catch_unwind(AssertUnwindSafe(|| node.try_cleanup_dead_nodes().cleanups));
    cleaned.unwrap_or_else(|_| {
        log::error!("what a dead client left behind cannot be cleaned up as a whole");
        0
    })
}

fn sweep(dir: &RuntimeDir, instance: &InstanceName, stop: &AtomicBool) {
    let node = match Services::janitor_node(dir, instance) {
        Ok(node) => node,
        Err(error) => {
            log::error!("dead clients will not be cleaned up: {error}");
            return;
        }
    };
    while !stop.load(Ordering::Relaxed) {
        remove_hollow_files(dir, instance);
        let cleanups = clean_up(&node);
        if cleanups > 0 {
            log::info!("cleaned up after {cleanups} dead client(s)");
        }
        std::thread::park_timeout(JANITOR_INTERVAL);
    }
}
