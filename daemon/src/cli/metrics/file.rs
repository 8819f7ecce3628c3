//! A file of metrics that is kept up to date: for the textfile collector of `node_exporter`.

use std::fs::Permissions;
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;

use super::{Format, Known, Scrape, text};
use crate::serve::{ServeError, StoppedThread};

/// Time between two files: a third of the shortest interval at which collectors usually look.
const INTERVAL: Duration = Duration::from_secs(5);
/// A signal to stop, or a metric that has come or gone, is noticed within this.
const LOOK: Duration = Duration::from_millis(500);

/// Other users' collectors read it.
const MODE: u32 = 0o644;

/// Writes the file until it is dropped, and removes it then: a collector would take old numbers for those of now.
pub struct MetricsFile {
    path: PathBuf,
    thread: Option<StoppedThread>,
}

impl MetricsFile {
    pub fn start(path: PathBuf, dir: RuntimeDir, name: InstanceName) -> Result<Self, ServeError> {
        let written = path.clone();
        let work = move |stop: &AtomicBool| write_until(&written, &dir, &name, stop);
        let thread = StoppedThread::start("metrics", "starting a thread", work)?;
        Ok(Self { path, thread: Some(thread) })
    }
}

impl Drop for MetricsFile {
    fn drop(&mut self) {
        drop(self.thread.take());
        // One that was never written is not there.
        let _ = std::fs::remove_file(&self.path);
    }
}

fn write_until(path: &Path, dir: &RuntimeDir, name: &InstanceName, stop: &AtomicBool) {
    let (mut is_reported, mut due) = (false, Instant::now());
    let mut last_known = Known::default();
    while !stop.load(Ordering::Relaxed) {
        let scrape = Scrape::of(dir, name);
        let known = scrape.known();
        if Instant::now() >= due || known != last_known {
            (due, last_known) = (Instant::now() + INTERVAL, known);
            let written = replace(path, &text(&[scrape], Format::Prometheus));
            if let Err(error) = written
                && !std::mem::replace(&mut is_reported, true)
            {
                log::warn!("{}: metrics cannot be written: {error}", path.display());
            }
        }
        std::thread::park_timeout(LOOK);
    }
}

/// Replaces the file in one step. What is half written has a name that no collector looks for.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut new = tempfile::NamedTempFile::new_in(folder.unwrap_or(Path::new(".")))?;
    new.write_all(text.as_bytes())?;
    new.as_file().set_permissions(Permissions::from_mode(MODE))?;
    new.persist(path)?;
    Ok(())
}
