//! The process that serves: what it needs, and its worker threads.
//!
//! One that starts beside a GPU measures this machine for a moment. Without that, the plan would give frames to a CPU twice as slow as that of the built-in constants where the GPU is
//! faster.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::engine::{AvailableIsa, CullError, CullInput, HeapReply, cpu_engine};
use pairmask_core::plan::{Calibration, SceneStats};
use pairmask_core::{Aabb, BoxCount, Encoding, EngineName, MaskView};
use pairmask_transport::{
    DaemonRecord, FreeChunks, GpuCounts, LimitError, Limits, PortTurn, SegmentFiles, Server,
    Services, StatusFile, address_space_left, clean_if_abandoned, process_name,
    quiet_transport_log, segment_file,
};
use pairmask_wire::{SkipTotals, StatusBody, Version};
use rustix::process::Signal;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::heartbeat::Beating;
use super::janitor::{Janitor, clean_up};
use super::worker_threads::WorkerThreads;
use super::{DaemonSettings, ServeError, ServeSettings};
use crate::audit::Auditor;
use crate::execute::gpu::{DEFAULT_HOLD, GpuChoices, IfMissing, OpenError};
use crate::execute::{EnginePool, Executor, GpuService};
use crate::ingest::Intake;
use crate::locked;
use crate::requests::Responder;
use crate::scene::{Scene, SceneName};

/// How long a predecessor may take to die. A daemon that has none to wait for starts at once.
const PREDECESSOR_DIES: Duration = Duration::from_secs(2);
/// The least mask that is worth serving: a dense one of 4,000 boxes.
const LEAST_REPLY_BYTES: u64 = 1 << 20;
const PREDECESSOR_LOOK: Duration = Duration::from_millis(10);

/// Serves an instance until SIGINT or SIGTERM, or until its parent, `supervisor`, ends.
pub fn work(settings: &ServeSettings, supervisor: u32) -> Result<(), ServeError> {
    quiet_transport_log();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(ServeError::system("installing signal handlers"))?;
    }
    bind_to(supervisor)?;
    let beating = Beating::start(&settings.dir, &settings.instance)?;
    let limits = limits_that_fit(&settings.daemon.limits)?;
    let daemon = DaemonSettings { limits, ..settings.daemon.clone() };
    let settings = &ServeSettings { daemon, ..settings.clone() };
    let daemon = &settings.daemon;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = daemon.threads.map_or(cores, usize::from).min(cores);
    let pool = Arc::new(EnginePool::with_this_thread(threads)?);

    // Beside what follows.
    let (isa, has_gpu) = (daemon.isa, may_have_gpu(&daemon.gpu));
    let constants = std::thread::Builder::new()
        .name("constants".into())
        .spawn(move || constants(isa, has_gpu))
        .map_err(ServeError::system("starting a thread"))?;
    let missing = Arc::new(Mutex::new(None));
    let gpus = open_gpus(settings, &missing, &stop);
    let (janitor, services) = open_services(settings, &beating.rounds)?;
    let server = open_server(&services, settings, &beating.has_no_files)?;
    if let Some(file) = segment_file(&settings.dir, &settings.instance, server.id().value()) {
        janitor.watch_over(file);
    }
    let mut early = Vec::new();
    let free = FreeChunks::of(&services, &server, limits.max_reply_bytes, &mut early)
        .inspect_err(|error| log::error!("memory of replies will not be given back: {error}"))
        .ok();
    let (wake, wake_clients) = services.wake_ports()?;
    let record = DaemonRecord {
        worker_pid: std::process::id(),
        supervisor_pid: supervisor,
        version: Version::CURRENT,
    };
    let body = StatusBody { pid: record.worker_pid, ..StatusBody::default() };
    let opening = GpuCounts { opening: gpus.len() as u32, open: 0 };
    let status = StatusFile::now(body, SkipTotals::default(), opening);
    if let Err(error) = settings.dir.write_status(&settings.instance, &status) {
        log::warn!("`pairmaskd status` will have to connect: {error}");
    }
    settings.dir.write_record(&settings.instance, &record)?;
    log::info!("serving '{}' with {threads} threads", settings.instance);

    let calibration = constants.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    let executor = Executor::new(gpus).with_engines(isa, calibration);
    let auditor =
        Auditor::start(daemon.audit).map_err(ServeError::system("starting the auditor"))?;
    let (services, turn) = (Arc::new(services), Arc::new(PortTurn::default()));
    let files = SegmentFiles::new(&settings.dir, &settings.instance);
    let intake = Intake::new(server, Arc::clone(&turn), Arc::clone(&services), files, early);
    let responder = Responder::new(
        services,
        (turn, free),
        wake_clients,
        settings,
        executor,
        Arc::clone(&pool),
        auditor,
    )?;
    let threads =
        WorkerThreads::new(intake, wake, responder, pool.threads(), settings, &janitor, &stop);
    threads.run()?;
    // Without a record it is no worker that died: the supervisor waits for its status.
    settings.dir.remove_record(&settings.instance);
    // What follows may take a while, and is no hanging.
    drop(beating);
    // Its threads may have used the devices, which are closed now: until then they stay (`gpu::slot`).
    drop(pool);
    drop(janitor);
    if let Some(error) = locked(&missing).take() {
        // The supervisor takes a worker without a record for one that never served, and ends with its message.
        return Err(error.into());
    }
    log::info!("stopped serving '{}'", settings.instance);
    Ok(())
}

/// Ends this process with its supervisor: without one, a worker would hold the instance for ever. The
/// kernel reports an end from now on; of one before, the parent that this process has now.
fn bind_to(supervisor: u32) -> Result<(), ServeError> {
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|e| ServeError::system("binding to the supervisor")(e.into()))?;
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get() as u32);
    if parent == supervisor { Ok(()) } else { Err(ServeError::Orphaned { supervisor }) }
}

/// Limits whose replies fit the address space that batch queues and service managers allow.
fn limits_that_fit(asked: &Limits) -> Result<Limits, LimitError> {
    let Some(left) = address_space_left() else { return Ok(*asked) };
    // The other half is for engines, scenes and clients' segments.
    let limits = asked.within(left / 2);
    if limits.max_reply_bytes < LEAST_REPLY_BYTES.min(asked.max_reply_bytes) {
        let (bytes, limit) = (asked.address_space(), left);
        return Err(LimitError::AddressSpace { bytes, limit });
    }
    if limits != *asked {
        log::warn!(
            "the largest mask is {} MiB and not {}: this process may use {} MiB of address space (RLIMIT_AS, `ulimit -v`)",
            limits.max_reply_bytes >> 20,
            asked.max_reply_bytes >> 20,
            left >> 20,
        );
    }
    Ok(limits)
}

/// The services. A predecessor that was killed while it made them left half of them, which can be taken
/// away as soon as it has died, and as long as we have no part in them.
fn open_services(
    settings: &ServeSettings,
    rounds: &Arc<AtomicU64>,
) -> Result<(Janitor, Services), ServeError> {
    let give_up_at = Instant::now() + PREDECESSOR_DIES;
    loop {
        clean_if_abandoned(&settings.dir, &settings.instance)?;
        settings.dir.ensure_transport_root(&settings.instance)?;
        let janitor = Janitor::start(&settings.dir, &settings.instance, Arc::clone(rounds))?;
        match Services::serve(&settings.dir, &settings.instance, &settings.daemon.limits) {
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
    services: &Services,
    settings: &ServeSettings,
    has_no_files: &Arc<AtomicBool>,
) -> Result<Server, ServeError> {
    let give_up_at = Instant::now() + PREDECESSOR_DIES;
    loop {
        clean_up(services.owner());
        match services.server(&settings.daemon.limits, has_no_files) {
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

/// Files of GPUs that drivers make: of render nodes, NVIDIA's, AMD's, and WSL's.
const GPU_FILES: [&str; 4] = ["/dev/dri", "/dev/nvidiactl", "/dev/kfd", "/dev/dxg"];

/// Whether a GPU may join. It takes too long to ask drivers.
fn may_have_gpu(requested: &GpuChoices) -> bool {
    let has_files = || GPU_FILES.iter().any(|file| Path::new(file).exists());
    !requested.is_none() && (!requested.is_optional() || has_files())
}

/// The constants that plans compute with.
///
/// Beside a GPU, whose times are measured, built-in times of the CPU's engines are those of another
/// machine: they are scaled by a short look at this one.
fn constants(isa: AvailableIsa, has_gpu: bool) -> Calibration {
    let built_in = Calibration::built_in(isa.get());
    if !has_gpu {
        return built_in;
    }
    glance(&built_in, isa).unwrap_or_else(|error| {
        log::warn!("planning with built-in constants as they are: {error}");
        built_in
    })
}

/// The GPUs that are needed, each being opened by a thread of its own: cores serve until it joins. `auto` and `all` do
/// without where there is none. One that is named has to open when the daemon starts; a worker that takes the place of
/// another goes on trying.
fn open_gpus(
    settings: &ServeSettings,
    missing: &Arc<Mutex<Option<OpenError>>>,
    stop: &Arc<AtomicBool>,
) -> Vec<GpuService> {
    let requested = &settings.daemon.gpu;
    if requested.is_none() {
        // Not even a look: listing adapters takes time and loads every driver.
        return Vec::new();
    }
    let if_missing = if requested.is_optional() {
        IfMissing::DoWithout
    } else if settings.restarted {
        IfMissing::TryAgain
    } else {
        let (missing, stop) = (Arc::clone(missing), Arc::clone(stop));
        IfMissing::Report(Arc::new(move |error| {
            locked(&missing).get_or_insert(error);
            stop.store(true, Ordering::Relaxed);
        }))
    };
    let open = |choice| {
        let hold = settings.daemon.gpu_awake.unwrap_or(DEFAULT_HOLD);
        GpuService::opening(&choice, hold, settings.watch_devices, if_missing.clone())
    };
    requested.each().into_iter().map(open).collect()
}

/// Boxes of the scenes that are timed: one small enough to compare all pairs, one that suits the grid.
const SIZES: [usize; 2] = [512, 4_096];
/// Every start has the same boxes.
const SEED: u64 = 1;
/// Frames of each engine, at least and at most. The shortest counts: the first touch memory, and other processes may
/// disturb some.
const FRAMES: (usize, usize) = (7, 22);
/// No further frame of a scene begins after this time, once there are enough: 15 ms in all on the machine of the
/// built-in constants.
const TIME: Duration = Duration::from_millis(5);

/// Measured over predicted time of an engine's frame; `None` is the client, which iterates over its pairs.
type Ratio = (Option<EngineName>, f64);

/// The constants of `start` scaled to this machine and `isa`: each engine by itself on one thread, and those of masks
/// by the time of iterating over their pairs.
pub(super) fn glance(start: &Calibration, isa: AvailableIsa) -> Result<Calibration, CullError> {
    let mut ratios: Vec<Ratio> = Vec::new();
    for n in SIZES {
        ratios.extend(measure(Scene::new(SceneName::Uniform, n, SEED).boxes(), start, isa)?);
    }
    let mean = |of: Option<EngineName>| {
        let own = ratios.iter().filter(|(owner, _)| *owner == of);
        let (count, log) = own.fold((0.0, 0.0), |(n, log), (_, ratio)| (n + 1.0, log + ratio.ln()));
        f64::exp(log / f64::max(count, 1.0))
    };
    let mut scaled = *start;
    for engine in EngineName::CPU {
        scaled.engines[engine.ordinal()] *= mean(Some(engine));
    }
    scaled.masks = scaled.masks.map(|times| times * mean(None));
    Ok(scaled)
}

/// The ratios of one scene, by the shortest times. The engines take turns frame by frame, so that a busy moment disturbs
/// all of them.
fn measure(
    boxes: &[Aabb],
    start: &Calibration,
    isa: AvailableIsa,
) -> Result<Vec<Ratio>, CullError> {
    let n = BoxCount::new(boxes.len() as u32);
    let input = CullInput::boxes(boxes).encoding(Encoding::Sparse).threads(1);
    let mut timed = Vec::new();
    for name in EngineName::CPU {
        timed.push((name, cpu_engine(name, isa.get())?, [u64::MAX; 2], 0));
    }
    let (least, most) = FRAMES;
    let (begin, mut reply) = (Instant::now(), HeapReply::new());
    for frame in 0..most {
        if frame >= least && begin.elapsed() > TIME {
            break;
        }
        for (_, engine, [cull_ns, iterate_ns], pairs) in &mut timed {
            let start = Instant::now();
            let report = engine.cull(&input, &mut reply)?;
            *cull_ns = nanoseconds_since(start).min(*cull_ns);
            let start = Instant::now();
            // An engine's mask is well-formed.
            if let Ok(mask) = MaskView::new(n, &report.shape, reply.words()) {
                let mut indices = 0;
                mask.with_isa(isa).for_each(|a, b| indices ^= a ^ b);
                std::hint::black_box(indices);
            }
            *iterate_ns = nanoseconds_since(start).min(*iterate_ns);
            *pairs = report.pair_count;
        }
    }
    let ratio = |ns: u64, predicted_ns: f64| ns.max(1) as f64 / predicted_ns.max(1.0);
    let ratios = timed.into_iter().flat_map(|(name, _, [cull_ns, iterate_ns], pairs)| {
        let stats = SceneStats::glance(boxes, Some(pairs));
        let predicted_ns = start.cull_ns(name, Encoding::Sparse, &stats);
        let cull = predicted_ns.map_or(1.0, |predicted_ns| ratio(cull_ns, predicted_ns));
        let iterate = ratio(iterate_ns, start.iterate_ns(name, Encoding::Sparse, &stats));
        [(Some(name), cull), (None, iterate)]
    });
    Ok(ratios.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_engine_is_scaled_by_itself() {
        let isa = AvailableIsa::best();
        let built_in = Calibration::built_in(isa.get());
        let mut slower = built_in;
        for times in slower.engines.iter_mut().chain(&mut slower.masks) {
            *times *= 1000.0;
        }
        let (found, found_of_slower) =
            (glance(&built_in, isa).expect("a look"), glance(&slower, isa).expect("a look"));
        let times = |found: Calibration| {
            let cpu = EngineName::CPU.map(|engine| found.engines[engine.ordinal()]);
            [&cpu[..], &found.masks].concat()
        };
        for (times, of_slower) in times(found).iter().zip(times(found_of_slower)) {
            // The start is dropped, regardless of what else runs on this machine.
            assert!((0.05..20.0).contains(&(times / of_slower)), "{times} {of_slower}");
        }
    }
}
