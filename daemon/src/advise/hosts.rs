//! Who serves: daemons that are started for it, and this process.

use std::time::Duration;

use pairmask::{Backend, ConnectError, Session};

use super::options::{Host, Way};
use crate::daemon_cpu::{DaemonCpu, own_cpu};
use crate::execute::gpu::GpuChoice;
use crate::serve::DaemonSettings;
use crate::spawn::{PrivateDaemon, SpawnError, open_gpus};

/// How long one tick may take: all pairs of a million boxes on one thread.
const DEADLINE: Duration = Duration::from_secs(600);

/// Daemons of their own, one without a GPU and one with it where there is one.
pub struct Hosts {
    settings: DaemonSettings,
    cores: Option<Served>,
    gpu: Option<Served>,
}

struct Served {
    daemon: PrivateDaemon,
    cpu: Option<DaemonCpu>,
}

impl Hosts {
    /// Starts them. Settings name the GPU.
    pub fn start(settings: DaemonSettings) -> Result<Self, SpawnError> {
        let cores =
            Served::start(&DaemonSettings { gpu: GpuChoice::None.into(), ..settings.clone() })?;
        let gpu = (!settings.gpu.is_none()).then(|| Served::start(&settings)).transpose()?;
        let gpu =
            gpu.filter(|Served { daemon, .. }| open_gpus(&daemon.dir(), &daemon.instance()) > 0);
        Ok(Self { settings, cores: Some(cores), gpu })
    }

    /// Without daemons.
    #[cfg(test)]
    pub(super) fn of_process() -> Self {
        Self { settings: DaemonSettings::default(), cores: None, gpu: None }
    }

    pub const fn has_gpu(&self) -> bool {
        self.gpu.is_some()
    }

    const fn served(&self, host: Host) -> Option<&Served> {
        match host {
            Host::InProcess => None,
            Host::Daemon => self.cores.as_ref(),
            Host::Gpu => self.gpu.as_ref(),
        }
    }

    /// CPU time of this process and the daemon of a host.
    pub(super) fn cpu(&self, host: Host) -> Duration {
        let daemon = self.served(host).and_then(|served| served.cpu.as_ref());
        own_cpu() + daemon.map_or(Duration::ZERO, DaemonCpu::used)
    }

    pub(super) fn connect(&self, way: &Way) -> Result<Session, ConnectError> {
        let builder =
            Session::builder().isa(self.settings.isa).engine(way.engine).deadline(DEADLINE);
        let builder = match self.served(way.host) {
            Some(served) => {
                let (dir, instance) = (served.daemon.dir(), served.daemon.instance());
                builder.runtime_dir(dir).instance(instance.as_str()).backend(Backend::Daemon)
            }
            None => builder.backend(Backend::InProcess),
        };
        match way.threads {
            Some(threads) => builder.threads(threads),
            None => builder,
        }
        .connect()
    }
}

impl Served {
    fn start(settings: &DaemonSettings) -> Result<Self, SpawnError> {
        let daemon = PrivateDaemon::start_self(settings)?;
        let cpu = DaemonCpu::of(&daemon.dir(), &daemon.instance());
        Ok(Self { daemon, cpu })
    }
}
