//! Pins client and daemon to a core each, so that the figures are free of the scheduler's moves.

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// Why threads were not pinned.
#[derive(Debug, thiserror::Error)]
pub enum PinError {
    /// Two spinning threads cannot share one core.
    #[error("--pin needs two cores, one for the client and one for the daemon: leave it out")]
    TooFewCores,
    /// No daemon to pin.
    #[error("--pin: no daemon serves instance '{instance}'")]
    NoDaemon {
        /// The instance.
        instance: InstanceName,
    },
    /// The system refused.
    #[error("--pin: {0}")]
    System(#[from] rustix::io::Errno),
}

/// Cores that this process could use when it started.
#[derive(Debug)]
pub struct Cores {
    all: CpuSet,
    client: usize,
    daemon: usize,
}

impl Cores {
    /// The cores of the calling thread, which must not be pinned yet.
    ///
    /// # Errors
    /// [`PinError::TooFewCores`], [`PinError::System`].
    pub fn of_this_thread() -> Result<Self, PinError> {
        let all = sched_getaffinity(None)?;
        let mut cores = (0..CpuSet::MAX_CPU).filter(|core| all.is_set(*core));
        let (client, daemon) = cores.next().zip(cores.next()).ok_or(PinError::TooFewCores)?;
        Ok(Self { all, client, daemon })
    }

    /// Gives the calling thread all cores back: a process that it starts inherits them.
    ///
    /// # Errors
    /// [`PinError::System`].
    pub fn unpin(&self) -> Result<(), PinError> {
        Ok(sched_setaffinity(None, &self.all)?)
    }

    /// Keeps the calling thread on one core, and the thread that serves the instance on another.
    ///
    /// # Errors
    /// [`PinError::NoDaemon`], [`PinError::System`].
    pub fn pin(&self, dir: &RuntimeDir, instance: &InstanceName) -> Result<(), PinError> {
        // The serving thread is its process's first, so it has the process's number. The engines'
        // other threads stay free.
        let serving = dir
            .serving(instance)
            .read_record(instance)
            .and_then(|record| Pid::from_raw(i32::try_from(record.worker_pid).ok()?))
            .ok_or_else(|| PinError::NoDaemon { instance: instance.clone() })?;
        sched_setaffinity(Some(serving), &only(self.daemon))?;
        Ok(sched_setaffinity(None, &only(self.client))?)
    }
}

fn only(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}
