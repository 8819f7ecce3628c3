//! The process that the user starts. It holds the instance and keeps a worker running.

use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

use pairmask_transport::{InstanceLock, ProcessWatch, clean_if_abandoned};
use pairmask_wire::InstanceError;
use rustix::process::{Pid, Signal, kill_process};
use signal_hook::consts::{SIGCHLD, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::restart_delay::RestartDelay;
use super::{ServeError, ServeSettings};

/// How long to wait for the lock of a supervisor that is gone. One that lives is not waited for.
const PREDECESSOR_LETS_GO: Duration = Duration::from_secs(1);
/// Between two looks whether it has.
const PREDECESSOR_LOOK: Duration = Duration::from_millis(5);
/// A worker that was asked to stop has this long: more than its longest sleep and one frame.
const STOP_WITHIN: Duration = Duration::from_secs(5);

/// Serves an instance until SIGINT or SIGTERM.
///
/// # Errors
/// [`ServeError`]; a worker that crashes is none.
pub fn supervise(settings: &ServeSettings) -> Result<(), ServeError> {
    let _lock = acquire(settings)?;
    let result = keep_working(settings);
    settings.dir.remove_record(&settings.instance);
    // Where there is none, none was measured.
    let _ = std::fs::remove_file(settings.dir.constants_file(&settings.instance));
    clean_if_abandoned(&settings.dir, &settings.instance)?;
    result
}

/// Takes the right to serve. A predecessor that was killed while it started a worker holds it through
/// that worker, until the worker has its own program: a moment that is waited for.
fn acquire(settings: &ServeSettings) -> Result<InstanceLock, InstanceError> {
    let give_up_at = Instant::now() + PREDECESSOR_LETS_GO;
    loop {
        match InstanceLock::acquire(&settings.dir, &settings.instance) {
            Err(InstanceError::AlreadyServed { pid, .. })
                if ProcessWatch::open(pid).is_none() && Instant::now() < give_up_at =>
            {
                std::thread::sleep(PREDECESSOR_LOOK);
            }
            done => return done,
        }
    }
}

fn keep_working(settings: &ServeSettings) -> Result<(), ServeError> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGCHLD])
        .map_err(ServeError::system("installing signal handlers"))?;
    let mut delay = RestartDelay::default();
    let mut served_before = false;
    loop {
        settings.dir.remove_record(&settings.instance);
        let mut worker = spawn_worker(settings, served_before)?;
        let Some(status) = watch(&mut worker, &mut signals)? else {
            return stop(&mut worker);
        };
        served_before |= settings.dir.read_record(&settings.instance).is_some();
        settings.dir.remove_record(&settings.instance);
        match status.code() {
            Some(0) => return Ok(()),
            Some(code) if !served_before => return Err(ServeError::Worker { code }),
            _ => {}
        }
        log::error!("the worker of '{}' died ({status}); starting another", settings.instance);
        if sleep_or_stop(delay.of_death(Instant::now()), &mut signals) {
            return Ok(());
        }
    }
}

fn spawn_worker(settings: &ServeSettings, restarted: bool) -> Result<Child, ServeError> {
    let binary =
        std::env::current_exe().map_err(ServeError::system("finding the daemon's binary"))?;
    Command::new(binary)
        .args(["serve", "--worker", &std::process::id().to_string()])
        .args(["--instance", settings.instance.as_str()])
        .args(["--spin-us", &settings.spin.as_micros().to_string()])
        .args(["--max-clients", &settings.limits.max_clients.to_string()])
        .args(["--max-reply-mib", &(settings.limits.max_reply_bytes >> 20).to_string()])
        .args(["--max-scene-mib", &(settings.limits.max_scene_bytes >> 20).to_string()])
        .args(["--gpu", &settings.gpu.to_string()])
        .args(["--gpu-awake-ms", &settings.gpu_awake.as_millis().to_string()])
        .args(["--calibration", &settings.calibration.to_string()])
        .args(["--isa", &settings.isa.to_string()])
        .args(["--audit", &settings.audit.to_string()])
        .args(restarted.then_some("--restarted"))
        .env("PAIRMASK_RUNTIME_DIR", settings.dir.path())
        // Mesa's layer that sorts adapters asks the user's display which one it runs on. A daemon
        // has no display to ask, and its user chooses by --gpu.
        .env("NODEVICE_SELECT", "1")
        .spawn()
        .map_err(ServeError::system("starting the worker"))
}

/// Waits for the worker's end, or `None` for a signal to stop.
fn watch(worker: &mut Child, signals: &mut Signals) -> Result<Option<ExitStatus>, ServeError> {
    loop {
        if let Some(status) =
            worker.try_wait().map_err(ServeError::system("watching the worker"))?
        {
            return Ok(Some(status));
        }
        if signals.wait().any(|signal| signal != SIGCHLD) {
            return Ok(None);
        }
    }
}

fn stop(worker: &mut Child) -> Result<(), ServeError> {
    if let Some(pid) = i32::try_from(worker.id()).ok().and_then(Pid::from_raw) {
        // A worker that has ended by itself meanwhile needs no signal.
        let _ = kill_process(pid, Signal::TERM);
    }
    let deadline = Instant::now() + STOP_WITHIN;
    while Instant::now() < deadline {
        if worker.try_wait().map_err(ServeError::system("watching the worker"))?.is_some() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    worker.kill().map_err(ServeError::system("killing the worker"))?;
    worker.wait().map_err(ServeError::system("watching the worker"))?;
    Ok(())
}

/// Sleeps; `true` where a signal to stop came.
fn sleep_or_stop(pause: Duration, signals: &mut Signals) -> bool {
    std::thread::sleep(pause);
    signals.pending().any(|signal| signal != SIGCHLD)
}
