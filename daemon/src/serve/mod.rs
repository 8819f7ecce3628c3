//! Serving an instance: a supervisor that stays, and a worker that does the work.
//!
//! A process with the same rights can kill the worker through the transport itself (a truncated
//! segment, a forged length). The supervisor starts another, also where the worker is stopped, ends
//! itself because it hangs, or fails the supervisor's own frames; clients answer their frames in process meanwhile and come back by themselves.

pub mod fences;
mod heartbeat;
mod probe;
mod service_manager;
mod signals;
mod status_writer;
mod supervisor;
mod worker;
mod worker_threads;

pub(crate) use self::service_manager::without_manager;
pub(crate) use self::supervisor::stop;
pub use self::supervisor::{FILES_PER_CLIENT, OWN_FILES, supervise};
pub use self::worker::work;

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use pairmask_core::engine::AvailableIsa;
use pairmask_core::usable_memory;
use pairmask_transport::{Limits, RuntimeDir, TransportError};
use pairmask_wire::{InstanceError, InstanceName};

use self::fences::{Refusal, WithoutFences};
use crate::audit::AuditRate;
use crate::execute::WatchDevice;
use crate::execute::gpu::{GpuChoices, OpenError};
use crate::publish::AlterAnswer;
use crate::recording::{RecordError, RecordSettings};

#[derive(Clone, Debug)]
pub struct ServeSettings {
    pub instance: InstanceName,
    pub dir: RuntimeDir,
    pub daemon: DaemonSettings,
    /// Where the clients' requests are recorded, if anywhere.
    pub record: Option<RecordSettings>,
    /// Whether this process takes the place of a worker that has served.
    pub restarted: bool,
    /// What becomes of the worker's system calls that are denied.
    pub refusal: Refusal,
    /// Changes every answer; `None` but in tests of the auditor. A supervisor cannot pass it on to
    /// its worker: the binary that both run sets it.
    pub alter_answers: Option<AlterAnswer>,
    /// Is shown each device that is opened; `None` but in tests that lose it, whose process is the worker.
    pub watch_devices: Option<WatchDevice>,
}

/// What a daemon takes of the machine, wherever it serves.
#[derive(Clone, Debug)]
pub struct DaemonSettings {
    pub limits: Limits,
    /// Threads that cull; `None` is one a core.
    pub threads: Option<NonZeroUsize>,
    /// How long the worker spins for the next request before it sleeps: longer for a client that comes
    /// back within a millisecond, and from shortly before a steady client's next frame is due; not at all
    /// where this is zero.
    pub spin: Duration,
    pub gpu: GpuChoices,
    /// How long their clocks are kept up after a frame, where it is not [`DEFAULT_HOLD`](crate::execute::gpu::DEFAULT_HOLD).
    pub gpu_awake: Option<Duration>,
    /// The instruction set of the CPU's engines.
    pub isa: AvailableIsa,
    /// The share of the frames that are checked again.
    pub audit: AuditRate,
    pub without_fences: WithoutFences,
    /// How often the supervisor tests the worker; never where this is zero.
    pub probe_interval: Duration,
}

impl Default for DaemonSettings {
    fn default() -> Self {
        let limits = Limits::default();
        let max_memory_bytes = usable_memory::bytes().map_or(limits.max_memory_bytes, daemon_part);
        Self {
            limits: Limits { max_memory_bytes, ..limits },
            threads: None,
            spin: DEFAULT_SPIN,
            gpu: GpuChoices::default(),
            gpu_awake: None,
            isa: AvailableIsa::best(),
            audit: AuditRate::Off,
            without_fences: WithoutFences::default(),
            probe_interval: probe::DEFAULT_INTERVAL,
        }
    }
}

impl DaemonSettings {
    /// As flags of `serve`.
    pub(crate) fn flags(&self) -> Vec<String> {
        let Self {
            limits,
            threads,
            spin,
            gpu,
            gpu_awake,
            isa,
            audit,
            without_fences,
            probe_interval,
        } = self;
        let mut flags = vec![
            format!("--spin-us={}", spin.as_micros()),
            format!("--max-clients={}", limits.max_clients),
            format!("--max-reply-mib={}", limits.max_reply_bytes >> 20),
            format!("--max-memory={}", limits.max_memory_bytes),
            format!("--gpu={gpu}"),
            format!("--isa={isa}"),
            format!("--audit={audit}"),
            format!("--without-fence={without_fences}"),
            format!("--probe-ms={}", probe_interval.as_millis()),
        ];
        flags.extend(threads.map(|threads| format!("--threads={threads}")));
        flags.extend(gpu_awake.map(|hold| format!("--gpu-awake-ms={}", hold.as_millis())));
        flags
    }
}

/// A worker that has served spins this long for the next request: a closed loop is answered
/// within a microsecond, and a game at 60 frames a second costs 3 ms of a core a second, beside the
/// 20 to 30 ms in which the worker is awake before its frames.
pub const DEFAULT_SPIN: Duration = Duration::from_micros(50);

/// Time between two looks at what clients left, and between two status files: memory of a client that has ended is free
/// again within a second.
const TIDY_INTERVAL: Duration = Duration::from_millis(500);

/// A thread that is asked to stop, woken and joined when this is dropped.
pub(crate) struct StoppedThread {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl StoppedThread {
    pub(crate) fn start(
        name: &str,
        step: &'static str,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> Result<Self, ServeError> {
        let stop = Arc::new(AtomicBool::new(false));
        let reported = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || work(&reported));
        Ok(Self { stop, thread: Some(thread.map_err(ServeError::system(step))?) })
    }

    pub(crate) fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }
}

impl Drop for StoppedThread {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.wake();
        if let Some(thread) = self.thread.take() {
            // One that panicked has said so.
            let _ = thread.join();
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    #[error(transparent)]
    Instance(#[from] InstanceError),
    #[error(transparent)]
    Transport(#[from] TransportError),
    #[error(transparent)]
    Gpu(#[from] OpenError),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error("{step}: {source}")]
    System { step: &'static str, source: std::io::Error },
    /// The supervisor ended before its worker could bind itself to it.
    #[error(
        "the supervisor, process {supervisor}, has exited: its worker does not serve without it"
    )]
    Orphaned { supervisor: u32 },
    #[error(
        "{clients} clients need up to {needed} open files, and a process may have {limit} (RLIMIT_NOFILE): raise the hard limit (`ulimit -Hn`){}",
        if *fit > 0 { format!(", or serve with --max-clients {fit}") } else { String::new() }
    )]
    Files { clients: usize, needed: u64, limit: u64, fit: u64 },
    /// The worker gave up before it served at all; it said why itself.
    #[error("the worker could not serve (exit code {code})")]
    Worker { code: i32 },
}

impl ServeError {
    fn system(step: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::System { step, source }
    }
}

/// The daemon takes at most two thirds of the memory for its clients, unless the user says otherwise: one client a third.
/// The last third is left to clients and to all else.
fn daemon_part(bytes: u64) -> u64 {
    (bytes / 3 * 2).max(LEAST_MEMORY)
}

/// The least memory that a daemon keeps to, bytes: a process that serves takes some 10 MiB before it has a client, and
/// each of them needs room for a small frame.
pub const LEAST_MEMORY: u64 = 64 << 20;
