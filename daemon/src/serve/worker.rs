//! The process that serves: what it needs, and its worker threads.
//!
//! One that starts beside a GPU measures this machine for a moment. Without that, the plan would give frames to a CPU twice as slow as that of the built-in constants where the GPU is
//! faster.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::engine::{AvailableIsa, CullError, CullInput, HeapReply, cpu_engine};
use pairmask_core::plan::{Calibration, SceneStats};
use pairmask_core::{Aabb, BoxCount, Encoding, EngineName, MaskView};
use pairmask_transport::{
    Budget, Counters, DaemonRecord, Door, GpuCounts, StatusFile, quiet_transport_log,
    remove_left_files, survive_cut_memory,
};
use pairmask_wire::{SkipTotals, StatusBody, Version};
use rustix::process::Signal;

use super::fences;
use super::heartbeat::Beating;
use super::signals::stop_signals;
use super::status_writer::StatusWriter;
use super::worker_threads::WorkerThreads;
use super::{ServeError, ServeSettings};
use crate::audit::Auditor;
use crate::execute::gpu::{DEFAULT_HOLD, GpuChoices, IfMissing, OpenError};
use crate::execute::{EnginePool, Executor, GpuService};
use crate::ingest::Intake;
use crate::locked;
use crate::recording::{RecordFile, Recorder};
use crate::requests::{EndWithPanic, Responder};
use crate::scene::{Scene, SceneName};

/// Serves an instance until a signal asks it to stop, or until its parent, `supervisor`, ends.
pub fn work(settings: &ServeSettings, supervisor: u32) -> Result<(), ServeError> {
    quiet_transport_log();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in stop_signals() {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(ServeError::system("installing signal handlers"))?;
    }
    bind_to(supervisor)?;
    // No file of the user's is opened behind the fences.
    let file = match &settings.record {
        // Clients wait for a worker that takes the place of another, recorded or not.
        Some(record) if settings.restarted => RecordFile::go_on(record)
            .inspect_err(|error| log::warn!("the recording has ended: {error}"))
            .ok(),
        record => record.as_ref().map(RecordFile::create).transpose()?,
    };
    let fences = fences::raise(settings);
    let beating = Beating::start(&settings.dir, &settings.instance)?;
    survive_cut_memory().map_err(ServeError::system("installing a signal handler"))?;
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
    remove_left_files(&settings.dir, &settings.instance);
    let writer =
        StatusWriter::start(&settings.dir, &settings.instance, Arc::clone(&beating.rounds))?;
    let limits = &daemon.limits;
    // Shared scenes have a share as a client has, and so has the supervisor.
    let budget = Budget::new(limits.max_memory_bytes, limits.max_clients + 2);
    let counters = counters(settings);
    let (dir, instance) = (&settings.dir, &settings.instance);
    let door = Door::open(dir, instance, limits.max_clients, budget, counters)?;
    let (door, porter) = attended(door)?;
    let record = DaemonRecord {
        worker_pid: std::process::id(),
        supervisor_pid: supervisor,
        version: Version::CURRENT,
        fences: fences.number(),
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
    let (recorder, recording) = file.map(Recorder::start).transpose()?.unzip();
    let pools = Arc::clone(&pool);
    let responder =
        Responder::new(Arc::clone(&door), settings, executor, pools, auditor, recorder)?;
    let intake = Intake::new(Arc::clone(&door));
    let threads = WorkerThreads::new(intake, responder, pool.threads(), settings, &writer, &stop);
    threads.run()?;
    // Without a record it is no worker that died: the supervisor waits for its status.
    settings.dir.remove_record(&settings.instance);
    // What follows may take a while, and is no hanging.
    drop(beating);
    // Its threads may have used the devices, which are closed now: until then they stay (`gpu::slot`).
    drop(pool);
    drop(writer);
    // What was answered is written.
    drop(recording);
    door.end();
    porter.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
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

fn counters(settings: &ServeSettings) -> Arc<Counters> {
    let clients = settings.daemon.limits.max_clients;
    Counters::create(&settings.dir, &settings.instance, clients).unwrap_or_else(|error| {
        log::warn!("`pairmaskd top` will not see this daemon's clients: {error}");
        Counters::unseen(clients)
    })
}

/// A thread lets clients in, from now on.
fn attended(door: Door) -> Result<(Arc<Door>, JoinHandle<()>), ServeError> {
    let door = Arc::new(door);
    let attends = Arc::clone(&door);
    let attend = move || {
        let _end = EndWithPanic;
        if let Err(error) = attends.attend() {
            // Nobody would be let in any more: the supervisor starts another worker.
            log::error!("{error}");
            std::process::abort();
        }
    };
    let thread = std::thread::Builder::new().name("door".into()).spawn(attend);
    Ok((door, thread.map_err(ServeError::system("starting a thread"))?))
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
