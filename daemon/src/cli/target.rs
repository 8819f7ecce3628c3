//! The daemon that a measurement uses, if any.

use std::time::Duration;

use pairmask::{Backend, SessionBuilder};
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;

use super::machine::value;
use super::options::{CommonOptions, CullFlags, DaemonOptions};
use crate::daemon_cpu::DaemonCpu;
use crate::serve::DaemonSettings;
use crate::spawn::{PrivateDaemon, SpawnError};

/// How long one frame of a measurement may take: all pairs of a million boxes on one thread.
pub const DEADLINE: Duration = Duration::from_secs(600);

pub struct Target {
    pub dir: RuntimeDir,
    pub instance: InstanceName,
    backend: Backend,
    _daemon: Option<PrivateDaemon>,
}

impl Target {
    /// The instance that the user named, else a private daemon for so many clients.
    pub fn new(
        options: &CullFlags,
        daemon: &DaemonOptions,
        spin: Duration,
        clients: u32,
        common: &CommonOptions,
    ) -> Result<Self, SpawnError> {
        let backend = options.backend(common, Backend::Daemon);
        let named = common.named_instance();
        if backend == Backend::Daemon && named.is_none() {
            let mut settings = DaemonSettings { spin, ..daemon.private(common) };
            // One slot more: that of the session which found the daemon may not be free yet.
            settings.limits.max_clients = settings.limits.max_clients.max(clients as usize + 1);
            let daemon = PrivateDaemon::start_self(&settings)?;
            let (dir, instance) = (daemon.dir(), daemon.instance());
            return Ok(Self { dir, instance, backend, _daemon: Some(daemon) });
        }
        let (dir, instance) = (common.runtime_dir(), named.unwrap_or_default());
        Ok(Self { dir, instance, backend, _daemon: None })
    }

    /// The instance that the user named, else a private daemon.
    pub fn daemon(daemon: &DaemonOptions, common: &CommonOptions) -> Result<Self, SpawnError> {
        match common.named_instance() {
            None => Self::private(daemon, common),
            Some(instance) => {
                let (dir, backend) = (common.runtime_dir(), Backend::Daemon);
                Ok(Self { dir, instance, backend, _daemon: None })
            }
        }
    }

    /// A private daemon.
    pub fn private(daemon: &DaemonOptions, common: &CommonOptions) -> Result<Self, SpawnError> {
        let daemon = PrivateDaemon::start_self(&daemon.private(common))?;
        let (dir, instance, backend) = (daemon.dir(), daemon.instance(), Backend::Daemon);
        Ok(Self { dir, instance, backend, _daemon: Some(daemon) })
    }

    pub fn session(&self, builder: SessionBuilder, spin: Duration) -> SessionBuilder {
        builder
            .runtime_dir(self.dir.clone())
            .instance(self.instance.as_str())
            .backend(self.backend)
            .spin(spin)
            .deadline(DEADLINE)
    }

    /// The time that the daemon's processes use; `None` where no daemon is asked.
    pub fn cpu(&self) -> Option<DaemonCpu> {
        let has_daemon = self.backend != Backend::InProcess;
        has_daemon.then(|| DaemonCpu::of(&self.dir, &self.instance)).flatten()
    }

    /// Resident memory of this process and of the daemon's worker, bytes. Shared pages count in both.
    pub fn memory_bytes(&self) -> u64 {
        let worker = self.cpu().map_or(0, |daemon| resident_bytes(&daemon.worker().to_string()));
        resident_bytes("self") + worker
    }
}

/// `VmRSS` of a process; 0 where it no longer exists.
fn resident_bytes(process: &str) -> u64 {
    let kib = value(&format!("/proc/{process}/status"), "VmRSS", ':');
    let kib = kib.and_then(|text| text.strip_suffix(" kB")?.parse::<u64>().ok());
    1024 * kib.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn this_process_has_memory() {
        assert!(super::resident_bytes("self") > 100_000);
        assert_eq!(super::resident_bytes("nobody"), 0);
    }
}
