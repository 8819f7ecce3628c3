//! Serving an instance: a supervisor that stays, and a worker that does the work.
//!
//! A process with the same rights can kill the worker through the transport itself (a truncated
//! segment, a forged length). The supervisor starts another, also where the worker is stopped or ends
//! itself because it hangs; clients answer their frames in process meanwhile and come back by themselves.

mod heartbeat;
mod janitor;
mod lanes;
mod supervisor;
mod worker;

pub use self::supervisor::{FILES_PER_CLIENT, supervise};
pub use self::worker::work;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use pairmask_core::engine::AvailableIsa;
use pairmask_transport::{LimitError, Limits, RuntimeDir, TransportError};
use pairmask_wire::{InstanceError, InstanceName};

use crate::audit::AuditRate;
use crate::execute::WatchDevice;
use crate::execute::gpu::{GpuChoices, OpenError};
use crate::publish::AlterAnswer;

/// How to serve an instance.
#[derive(Clone, Debug)]
pub struct ServeSettings {
    /// Which instance.
    pub instance: InstanceName,
    /// Where instances live.
    pub dir: RuntimeDir,
    /// What the instance allows.
    pub limits: Limits,
    /// How long the worker spins for the next request before it sleeps: longer for a client that comes
    /// back within a millisecond, and from shortly before a steady client's next frame is due; not at all
    /// where this is zero.
    pub spin: Duration,
    /// Which GPUs.
    pub gpu: GpuChoices,
    /// Whether this process takes the place of a worker that has served.
    pub restarted: bool,
    /// How long their clocks are kept up after a frame.
    pub gpu_awake: Duration,
    /// The instruction set of the CPU's engines.
    pub isa: AvailableIsa,
    /// Which frames are audited.
    pub audit: AuditRate,
    /// Changes every answer; `None` but in tests of the auditor. A supervisor cannot pass it on to
    /// its worker: the binary that both run sets it.
    pub alter_answers: Option<AlterAnswer>,
    /// Is shown each device that is opened; `None` but in tests that lose it, whose process is the worker.
    pub watch_devices: Option<WatchDevice>,
}

/// A worker that has served spins this long for the next request: a closed loop is answered
/// within a microsecond, and a game at 60 frames a second costs 3 ms of a core a second, beside the
/// 20 to 30 ms in which the worker is awake before its frames.
pub const DEFAULT_SPIN: Duration = Duration::from_micros(50);

/// A thread that is told to stop, woken and joined when this is dropped.
struct StoppedThread {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl StoppedThread {
    fn start(
        name: &str,
        step: &'static str,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> Result<Self, ServeError> {
        let stop = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || work(&told));
        Ok(Self { stop, thread: Some(thread.map_err(ServeError::system(step))?) })
    }

    fn wake(&self) {
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

/// Why an instance is not served any more.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The instance's place on disk cannot be used, or another daemon has it.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The GPU that was asked for is not to be had.
    #[error(transparent)]
    Gpu(#[from] OpenError),
    /// No thread pool.
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The system refused a process, a signal handler or a thread.
    #[error("{step}: {source}")]
    System {
        /// What was tried.
        step: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The supervisor ended before its worker could bind itself to it.
    #[error("the supervisor, process {supervisor}, is gone: its worker does not serve without it")]
    Orphaned {
        /// The process that should have been the parent.
        supervisor: u32,
    },
    /// A process without a supervisor, or one that does not die, still has the server port.
    #[error(
        "process {pid} ({name}) still serves instance '{instance}' and does not go: end it \
         (kill -9 {pid}) and serve again"
    )]
    Blocked {
        /// The instance.
        instance: InstanceName,
        /// The process in the way.
        pid: u32,
        /// What it calls itself.
        name: String,
    },
    /// A limit of this process is too low for what is to be served.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// So many clients need more open files than a process may have.
    #[error(
        "{clients} clients need up to {needed} open files, and a process may have {limit} (RLIMIT_NOFILE): raise the hard limit (`ulimit -Hn`){}",
        if *fit > 0 { format!(", or serve with --max-clients {fit}") } else { String::new() }
    )]
    Files {
        /// Clients at a time.
        clients: usize,
        /// Open files of a worker with so many.
        needed: u64,
        /// The hard limit.
        limit: u64,
        /// Clients for whom there are enough.
        fit: u64,
    },
    /// The worker gave up before it served at all; it said why itself.
    #[error("the worker could not serve (exit code {code})")]
    Worker {
        /// Its exit code.
        code: i32,
    },
}

impl ServeError {
    fn system(step: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::System { step, source }
    }
}

/// Scenes take at most this part of the memory, unless the user says otherwise. A search among all boxes may find as
/// many bytes of pairs for a moment, and the last third is left to clients and to all else.
const SCENE_PART: u64 = 3;

/// Bytes of a MiB, the unit of the setting.
const MIB: u64 = 1 << 20;

/// Bytes that all scenes together may take on this machine, where nothing else is set; `otherwise` where the system
/// does not say how much memory there is.
pub(crate) fn default_scene_bytes(otherwise: u64) -> u64 {
    usable_bytes().map_or(otherwise, scene_part)
}

/// The scenes' part of so many bytes, in whole MiB.
fn scene_part(bytes: u64) -> u64 {
    (bytes / SCENE_PART / MIB).max(1) * MIB
}

/// Bytes of memory that this process may use.
fn usable_bytes() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().as_deref().and_then(total_bytes);
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let limits = limit_files(&groups).filter_map(|file| std::fs::read_to_string(file).ok());
    // A group without a limit says `max`, or a number beyond any memory.
    let limits = limits.filter_map(|text| text.trim().parse().ok());
    limits.chain(machine).min()
}

/// The memory of the machine, by the text of `/proc/meminfo`.
fn total_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Files that may hold a limit of the groups in the text of `/proc/self/cgroup`: of each group, and of those that it
/// is in, by the second and the first version of control groups.
fn limit_files(groups: &str) -> impl Iterator<Item = PathBuf> {
    groups.lines().flat_map(|line| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, group) = (fields.next().unwrap_or("-"), fields.next().unwrap_or("/"));
        let place = match controllers {
            "" => Some(("/sys/fs/cgroup", "memory.max")),
            all if all.split(',').any(|one| one == "memory") => {
                Some(("/sys/fs/cgroup/memory", "memory.limit_in_bytes"))
            }
            _ => None,
        };
        let group = Path::new(group.trim_start_matches('/'));
        let up =
            move |(root, name)| group.ancestors().map(move |g| Path::new(root).join(g).join(name));
        place.into_iter().flat_map(up)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_memory_is_read() {
        let text = "MemFree:  1 kB\nMemTotal:       24601460 kB\nMemAvailable: 3 kB\n";
        assert_eq!(total_bytes(text), Some(24_601_460 * 1024));
        assert_eq!(total_bytes("MemTotal: many kB"), None);
        assert_eq!(total_bytes(""), None);
        assert!(usable_bytes().is_some_and(|bytes| bytes > 1 << 20), "this machine has some");
    }

    #[test]
    fn a_group_and_those_around_it_may_limit_memory() {
        let files: Vec<_> = limit_files("0::/a/b\n").collect();
        let expected = ["a/b/memory.max", "a/memory.max", "memory.max"];
        assert_eq!(files, expected.map(|file| Path::new("/sys/fs/cgroup").join(file)));
        let files: Vec<_> =
            limit_files("5:cpu,memory:/x\n4:cpuset:/\n1:name=systemd:/\n").collect();
        let expected = ["x/memory.limit_in_bytes", "memory.limit_in_bytes"];
        assert_eq!(files, expected.map(|file| Path::new("/sys/fs/cgroup/memory").join(file)));
        assert_eq!(limit_files("0::/\n").count(), 1);
        assert_eq!(limit_files("nonsense\n\n").count(), 0);
    }

    #[test]
    fn scenes_take_a_third_in_whole_mebibytes() {
        assert_eq!(scene_part(256 << 30), (256 << 30) / 3 / MIB * MIB);
        assert_eq!(scene_part(0), MIB, "none would refuse every scene");
    }
}
