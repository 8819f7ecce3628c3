//! The process that serves: receives requests, takes turns among clients, answers.

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::service::ipc;
use pairmask_core::AwakePool;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::{Calibration, CalibrationChoice, CalibrationOrigin};
use pairmask_core::spinner::Spinner;
use pairmask_transport::{
    DaemonRecord, JANITOR_INTERVAL, SegmentFiles, Server, Services, StatusFile, WakeDaemon,
    clean_if_abandoned, process_name, quiet_transport_log,
};
use pairmask_wire::{StatusBody, Version};
use rustix::process::Signal;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::janitor::{Janitor, clean_up};
use super::patience::Patience;
use super::{ServeError, ServeSettings};
use crate::audit::Auditor;
use crate::calibrate::glance;
use crate::execute::gpu::{GpuChoice, OpenError};
use crate::execute::{Executor, GpuService};
use crate::ingest::{Gate, Inbox, Incoming};
use crate::requests::Responder;

/// The longest sleep: how soon a stop signal, a request without a wake-up and the end of a client
/// are noticed at the latest. Two wake-ups a second cost nothing that can be measured.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// How long a predecessor may take to die. A daemon that has none to wait for starts at once.
const PREDECESSOR_DIES: Duration = Duration::from_secs(2);
/// Between two looks whether it has.
const PREDECESSOR_LOOK: Duration = Duration::from_millis(10);

/// Serves an instance in this process until SIGINT or SIGTERM, or until its parent, the process
/// `supervisor`, ends.
///
/// # Errors
/// [`ServeError`] where the services cannot be made, and where `supervisor` is not the parent.
pub fn work(settings: &ServeSettings, supervisor: u32) -> Result<(), ServeError> {
    quiet_transport_log();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(ServeError::system("installing signal handlers"))?;
    }
    bind_to(supervisor)?;
    // This thread is one of the pool's own, so that an engine's parallel loops start without a
    // hand-over to another thread.
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let _pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .thread_name(|index| format!("engine-{index}"))
        .build()?;

    let gpu = open_gpu(&settings.gpu, settings.gpu_awake)?;
    let (janitor, services) = open_services(settings)?;
    let server = open_server(&services, settings)?;
    let (wake, wake_clients) = services.wake_ports()?;
    let record = DaemonRecord {
        worker_pid: std::process::id(),
        supervisor_pid: supervisor,
        version: Version::CURRENT,
    };
    let status = StatusFile::now(StatusBody { pid: record.worker_pid, ..StatusBody::default() });
    if let Err(error) = settings.dir.write_status(&settings.instance, &status) {
        log::warn!("`pairmaskd status` will have to connect: {error}");
    }
    settings.dir.write_record(&settings.instance, &record)?;
    log::info!("serving '{}' with {threads} threads", settings.instance);

    let calibration = constants(&settings.calibration, settings.isa, gpu.is_some());
    let executor = Executor::new(gpu).with_engines(settings.isa, calibration);
    let auditor =
        Auditor::start(settings.audit).map_err(ServeError::system("starting the auditor"))?;
    let services = Rc::new(services);
    let files = SegmentFiles::new(&settings.dir, &settings.instance);
    let mut gate = Gate::new(Rc::clone(&services), files);
    let mut responder = Responder::new(services, wake_clients, &settings.limits, executor, auditor);
    responder.alter_answers(settings.alter_answers);
    serve(&server, &wake, &mut gate, &mut responder, &janitor, settings, &stop);
    drop(janitor);
    log::info!("stopped serving '{}'", settings.instance);
    Ok(())
}

/// Ends this process with its supervisor: without one, a worker would hold the instance for ever.
///
/// The kernel tells of a parent's end from now on. One that ended before is told by the parent that
/// this process has now.
fn bind_to(supervisor: u32) -> Result<(), ServeError> {
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|e| ServeError::system("binding to the supervisor")(e.into()))?;
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get() as u32);
    if parent == supervisor { Ok(()) } else { Err(ServeError::Orphaned { supervisor }) }
}

/// The services. A predecessor that was killed while it made them left half of them, which can be taken
/// away as soon as it has died, and as long as we have no part in them.
fn open_services(
    settings: &ServeSettings,
) -> Result<(Janitor, Services<ipc::Service>), ServeError> {
    let give_up_at = Instant::now() + PREDECESSOR_DIES;
    loop {
        clean_if_abandoned(&settings.dir, &settings.instance)?;
        settings.dir.ensure_transport_root(&settings.instance)?;
        let janitor = Janitor::start(&settings.dir, &settings.instance)?;
        match Services::serve(&settings.dir, &settings.instance, &settings.limits) {
            Ok(services) => return Ok((janitor, services)),
            Err(error) if Instant::now() < give_up_at => {
                log::debug!("waiting for what a predecessor began: {error}");
                drop(janitor);
                std::thread::sleep(PREDECESSOR_LOOK);
            }
            Err(error) => return Err(error.into()),
        }
    }
}

/// The server port. A predecessor's may still be registered, and there can be one only: one that was
/// killed with its supervisor takes a moment to die, and can be cleaned up only then.
fn open_server(
    services: &Services<ipc::Service>,
    settings: &ServeSettings,
) -> Result<Server, ServeError> {
    let give_up_at = Instant::now() + PREDECESSOR_DIES;
    loop {
        clean_up(services.owner());
        match services.server(&settings.limits) {
            Err(error) if Instant::now() < give_up_at => {
                log::debug!("waiting for a predecessor to go: {error}");
                std::thread::sleep(PREDECESSOR_LOOK);
            }
            Err(error) => {
                let blocked = |process| ServeError::Blocked {
                    instance: settings.instance.clone(),
                    pid: process,
                    name: process_name(process),
                };
                return Err(services.serving_process().map_or(error.into(), blocked));
            }
            Ok(server) => return Ok(server),
        }
    }
}

/// The constants that plans compute with.
///
/// Beside a GPU, whose times are measured, built-in times of the CPU's engines are those of another
/// machine: they are scaled by a short look at this one.
fn constants(choice: &CalibrationChoice, isa: AvailableIsa, has_gpu: bool) -> Calibration {
    let (calibration, origin) = choice.resolve(isa);
    log::info!("planning with constants: {origin}");
    let is_built_in = matches!(origin, CalibrationOrigin::BuiltIn(_));
    if !has_gpu || !is_built_in || *choice == CalibrationChoice::BuiltIn {
        return calibration;
    }
    glance(&calibration, isa).unwrap_or_else(|error| {
        log::warn!("planning with built-in constants as they are: {error}");
        calibration
    })
}

/// The GPU, where one is wanted. `auto` does without where there is none.
fn open_gpu(choice: &GpuChoice, awake: Duration) -> Result<Option<GpuService>, OpenError> {
    if *choice == GpuChoice::None {
        // Not even a look: listing adapters takes time and loads every driver.
        return Ok(None);
    }
    match GpuService::open(choice, awake) {
        Ok(gpu) => Ok(Some(gpu)),
        Err(error) if *choice == GpuChoice::Auto => {
            log::info!("serving without a GPU: {error}");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

fn serve(
    server: &Server,
    wake: &WakeDaemon,
    gate: &mut Gate,
    responder: &mut Responder,
    janitor: &Janitor,
    settings: &ServeSettings,
    stop: &AtomicBool,
) {
    let mut inbox = Inbox::new(settings.limits.max_clients);
    let mut patience = Patience::new(settings.spin);
    let mut awake = AwakePool::default();
    // The client has a frame to look at: one core is left to it.
    let most_awake = rayon::current_num_threads().saturating_sub(1).max(1);
    let mut sleep_at = Instant::now();
    let mut tidy_at = sleep_at;
    let mut spinner = Spinner::default();
    while !stop.load(Ordering::Relaxed) {
        drain(server, gate, &mut inbox);
        let mut answered = awake.work(|| responder.publish_ended());
        if responder.has_room()
            && let Some(request) = inbox.next()
        {
            patience.note_request(Instant::now());
            awake.work(|| responder.take(request));
            answered = true;
        }
        let now = Instant::now();
        if now >= tidy_at {
            responder.tidy();
            janitor.post(&StatusFile::now(responder.status()));
            gate.tidy();
            tidy_at = now + JANITOR_INTERVAL;
        }
        if answered {
            sleep_at = now + patience.after_answer(now);
            awake.keep_until(responder.threads().min(most_awake), sleep_at);
        } else if responder.is_busy() {
            responder.rest();
        } else if now < sleep_at {
            spinner.turn();
        } else if let Err(error) = wake.timed_wait(|_| {}, LONGEST_SLEEP) {
            // A request that came between the last look and the wait has left its wake-up: it is
            // not lost, the wait returns at once.
            log::debug!("waiting for requests: {error:?}");
        }
    }
}

fn drain(server: &Server, gate: &mut Gate, inbox: &mut Inbox<Incoming>) {
    // As many as all clients may send at a time: a client that sends without end does not keep the loop here.
    for _ in 0..inbox.capacity() {
        if !inbox.has_room() {
            return;
        }
        match server.receive() {
            Ok(Some(request)) => {
                if let Some(incoming) = gate.admit(request) {
                    inbox.put(incoming.sender, incoming);
                }
            }
            Ok(None) => return,
            Err(error) => {
                // A client that died while it connected; the janitor takes the rest away.
                log::debug!("receiving requests: {error:?}");
                return;
            }
        }
    }
}
