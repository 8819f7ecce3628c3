//! The thread that takes away what dead clients left.
//!
//! A cleanup takes up to 24 ms for a client with 46 MB: too long for the thread that serves.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use pairmask::transport::{
    InstanceName, JANITOR_INTERVAL, RuntimeDir, Services, remove_hollow_files,
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
        let state = node.try_cleanup_dead_nodes();
        if state.cleanups > 0 {
            log::info!("cleaned up after {} dead client(s)", state.cleanups);
        }
        std::thread::park_timeout(JANITOR_INTERVAL);
    }
}
