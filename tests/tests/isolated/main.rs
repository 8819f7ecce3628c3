//! Tests that own what a process has once: its logger, its allocator, a device that they lose. They run one after the
//! other: each holds [`alone`].
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use pairmask_transport::{Limits, RuntimeDir};
use pairmask_wire::InstanceName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::serve::fences::{Refusal, WithoutFences};
use pairmaskd::serve::{DaemonSettings, ServeError, ServeSettings, work};

mod allocations;
mod forward_compatibility;
mod library_log;
mod scene_device_loss;

/// The process, for one test at a time. A test that failed leaves it as good as before.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Settings of a worker that is a thread of this process.
fn settings(dir: &Path) -> ServeSettings {
    ServeSettings {
        alter_answers: None,
        watch_devices: None,
        record: None,
        restarted: false,
        refusal: Refusal::Fails,
        instance: InstanceName::default(),
        dir: RuntimeDir::at(dir),
        daemon: DaemonSettings {
            limits: Limits::default(),
            gpu: GpuChoice::None.into(),
            gpu_awake: Some(Duration::ZERO),
            // The process is the test's.
            without_fences: WithoutFences::ALL,
            ..DaemonSettings::default()
        },
    }
}

/// Serves in this thread until the process is asked to end.
fn serve(settings: &ServeSettings) -> Result<(), ServeError> {
    let parent = rustix::process::getppid().expect("a parent").as_raw_nonzero().get();
    work(settings, parent as u32)
}
