//! The process that serves: receives requests, takes turns among clients, answers.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::service::ipc;
use pairmask::AwakePool;
use pairmask::plan::{Calibration, CalibrationChoice, CalibrationOrigin};
use pairmask::transport::{
    Account, ActiveRequest, DaemonRecord, JANITOR_INTERVAL, Limits, Server, Services, Spinner,
    TransportError, WakeDaemon, clean_if_abandoned, quiet_transport_log,
};
use pairmask::wire::{StatusBody, Version};
use rustix::process::Signal;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::janitor::Janitor;
use super::patience::Patience;
use super::{ServeError, ServeSettings};
use crate::audit::Auditor;
use crate::execute::gpu::{GpuChoice, OpenError};
use crate::execute::{Executor, GpuService};
use crate::ingest::Inbox;
use crate::publish::Publisher;
use crate::study::engines::glance;

/// The longest sleep: how soon a stop signal, a request without a wake-up and the end of a client
/// are noticed at the latest. Two wake-ups a second cost nothing that can be measured.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// How long a predecessor may take to die. A daemon that has none to wait for starts at once.
const PREDECESSOR_DIES: Duration = Duration::from_secs(2);
/// Between two looks whether it has.
const PREDECESSOR_LOOK: Duration = Duration::from_millis(10);

/// Serves an instance in this process until SIGINT or SIGTERM.
///
/// # Errors
/// [`ServeError`] where the services cannot be made.
pub fn work(settings: &ServeSettings) -> Result<(), ServeError> {
    quiet_transport_log();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(ServeError::system("installing signal handlers"))?;
    }
    // Without its supervisor a worker would hold the instance for ever.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|e| ServeError::system("binding to the supervisor")(e.into()))?;
    // This thread is one of the pool's own, so that an engine's parallel loops start without a
    // hand-over to another thread.
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let _pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .thread_name(|index| format!("engine-{index}"))
        .build()?;

    let gpu = open_gpu(&settings.gpu, settings.gpu_awake)?;
    clean_if_abandoned(&settings.dir, &settings.instance)?;
    settings.dir.ensure_transport_root(&settings.instance)?;
    settings.dir.check_shared_files(&settings.instance)?;
    let janitor = Janitor::start(&settings.dir, &settings.instance)?;
    let services = Services::serve(&settings.dir, &settings.instance, &settings.limits)?;
    let server = open_server(&services, &settings.limits)?;
    let (wake, wake_clients) = services.wake_ports()?;
    let record = DaemonRecord {
        worker_pid: std::process::id(),
        supervisor_pid: rustix::process::getppid()
            .map_or(0, |pid| pid.as_raw_nonzero().get() as u32),
        version: Version::CURRENT,
    };
    let account = Account::now(StatusBody { pid: record.worker_pid, ..StatusBody::default() });
    if let Err(error) = settings.dir.write_account(&settings.instance, &account) {
        log::warn!("`pairmaskd status` will have to connect: {error}");
    }
    settings.dir.write_record(&settings.instance, &record)?;
    log::info!("serving '{}' with {threads} threads", settings.instance);

    let calibration = constants(&settings.calibration, gpu.is_some());
    let executor = Executor::new(gpu).with_calibration(calibration);
    let auditor =
        Auditor::start(settings.audit).map_err(ServeError::system("starting the auditor"))?;
    let mut publisher = Publisher::new(services, wake_clients, &settings.limits, executor, auditor);
    publisher.break_engine(settings.break_engine);
    serve(&server, &wake, &mut publisher, &janitor, settings, &stop);
    drop(janitor);
    log::info!("stopped serving '{}'", settings.instance);
    Ok(())
}

/// The server port. A predecessor's may still be registered, and there can be one only: one that was
/// killed with its supervisor takes a moment to die, and can be cleaned up only then.
fn open_server(
    services: &Services<ipc::Service>,
    limits: &Limits,
) -> Result<Server, TransportError> {
    let give_up_at = Instant::now() + PREDECESSOR_DIES;
    loop {
        services.owner().try_cleanup_dead_nodes();
        match services.server(limits) {
            Err(error) if Instant::now() < give_up_at => {
                log::debug!("waiting for a predecessor to go: {error}");
                std::thread::sleep(PREDECESSOR_LOOK);
            }
            done => return done,
        }
    }
}

/// The constants that plans compute with.
///
/// Beside a GPU, whose times are measured, built-in times of the CPU's engines are those of another
/// machine: they are scaled by a short look at this one.
fn constants(choice: &CalibrationChoice, has_gpu: bool) -> Calibration {
    let (calibration, origin) = choice.resolve();
    log::info!("planning with constants: {origin}");
    let is_built_in = matches!(origin, CalibrationOrigin::BuiltIn(_));
    if !has_gpu || !is_built_in || *choice == CalibrationChoice::BuiltIn {
        return calibration;
    }
    glance(&calibration).unwrap_or_else(|error| {
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
    publisher: &mut Publisher,
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
        drain(server, &mut inbox);
        let mut answered = awake.work(|| publisher.publish_ended());
        if publisher.has_room()
            && let Some(request) = inbox.next()
        {
            patience.note_request(Instant::now());
            awake.work(|| publisher.take(request));
            answered = true;
        }
        let now = Instant::now();
        if now >= tidy_at {
            publisher.tidy();
            janitor.post(&Account::now(publisher.status()));
            tidy_at = now + JANITOR_INTERVAL;
        }
        if answered {
            sleep_at = now + patience.after_answer(now);
            awake.keep_until(publisher.threads().min(most_awake), sleep_at);
        } else if publisher.is_busy() {
            publisher.rest();
        } else if now < sleep_at {
            spinner.turn();
        } else if let Err(error) = wake.timed_wait(|_| {}, LONGEST_SLEEP) {
            // A request that came between the last look and the wait has left its wake-up: it is
            // not lost, the wait returns at once.
            log::debug!("waiting for requests: {error:?}");
        }
    }
}

fn drain(server: &Server, inbox: &mut Inbox<ActiveRequest>) {
    while inbox.has_room() {
        match server.receive() {
            Ok(Some(request)) => inbox.put(request.user_header().client_token, request),
            Ok(None) => return,
            Err(error) => {
                // A client that died while it connected; the janitor takes the rest away.
                log::debug!("receiving requests: {error:?}");
                return;
            }
        }
    }
}
