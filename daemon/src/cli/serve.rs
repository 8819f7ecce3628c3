//! `serve`: the daemon.

use std::num::{NonZeroU16, NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use clap::builder::FalseyValueParser;
use pairmask_transport::Limits;

use super::group::GroupId;
use super::memory_size::{FileSize, MemorySize};
use super::metrics::MetricsFile;
use super::options::{CommonOptions, DaemonOptions};
use super::whole_number::whole_number;
use crate::audit::AuditRate;
use crate::publish::AlterAnswer;
use crate::recording::RecordSettings;
use crate::serve::fences::{Refusal, WithoutFences};
use crate::serve::{DaemonSettings, ServeError, ServeSettings, supervise, work};
use crate::spawn;

/// Minutes of 10,000 boxes that all move, at 60 frames a second; hours of boxes that mostly rest.
const DEFAULT_RECORD_BYTES: u64 = 1 << 30;

/// Serve an instance until Ctrl-C, SIGTERM or SIGHUP
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd serve                             the instance named `default`
  pairmaskd serve --instance world --spin-us 1000
  pairmaskd serve --threads 4                 leaves the other cores to games
  pairmaskd serve --max-memory 2G             and no more than that for all clients
  pairmaskd serve --metrics-file /var/lib/node_exporter/pairmask.prom
  pairmaskd serve --audit 1/1000              missed and extra pairs are counted in `status`
  pairmaskd serve --record game.pmrec         what clients send, for `pairmaskd replay`

A second daemon for the same instance is refused. A daemon without work sleeps.")]
pub struct Serve {
    /// How long to spin for the next request before sleeping, µs; longer for a client that comes back
    /// within 1 ms, and from shortly before a steady client's next frame is due; 0 never spins
    /// [default: 50]
    #[arg(long, value_parser = whole_number::<u64>, env = "PAIRMASK_SPIN_US", value_name = "N")]
    spin_us: Option<u64>,
    /// Threads that cull; a short frame uses one or two of them [default: as many as there are cores]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, env = "PAIRMASK_THREADS", value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Clients at a time [default: 100]
    #[arg(long, value_parser = whole_number::<NonZeroU16>, env = "PAIRMASK_MAX_CLIENTS", value_name = "N")]
    max_clients: Option<NonZeroU16>,
    /// The largest mask, MiB [default: 1024]
    #[arg(long, value_parser = whole_number::<NonZeroU32>, env = "PAIRMASK_MAX_REPLY_MIB", value_name = "N")]
    max_reply_mib: Option<NonZeroU32>,
    /// Memory that is taken for clients: their boxes, scenes, on GPUs too, answers, and what engines need.
    /// One client may have half of it, and so may shared scenes; a quarter is kept in equal shares for each
    /// client [default: two thirds of this machine's memory, or of this control group's]
    #[arg(long, env = "PAIRMASK_MAX_MEMORY", value_name = "SIZE")]
    max_memory: Option<MemorySize>,
    #[command(flatten)]
    options: DaemonOptions,
    /// How long the GPU's clocks are kept up after a frame, ms; 0 leaves them alone [default: 250]
    #[arg(long, value_parser = whole_number::<u32>, env = "PAIRMASK_GPU_AWAKE_MS", value_name = "N")]
    gpu_awake_ms: Option<u32>,
    /// Check a share of the frames again with a naive oracle, in the background: 1/N or off
    /// [default: off]
    #[arg(long, env = "PAIRMASK_AUDIT", value_name = "RATE")]
    audit: Option<AuditRate>,
    /// Fences that the process that serves does without: no-new-privs, landlock, seccomp, rlimits, with
    /// commas between them, all or none [default: none]
    #[arg(long, env = "PAIRMASK_WITHOUT_FENCE", value_name = "NAMES")]
    without_fence: Option<WithoutFences>,
    /// Let members of this group in too, by name or number: the runtime directory has to be new, or open to it
    #[arg(long, env = "PAIRMASK_ALLOW_GROUP", value_name = "GROUP")]
    allow_group: Option<GroupId>,
    /// How often the process that serves is sent a frame of the daemon's own, and replaced where it answers that
    /// wrongly or not at all, ms; 0 never [default: 3000]
    #[arg(long, value_parser = whole_number::<u32>, env = "PAIRMASK_PROBE_MS", value_name = "N")]
    probe_ms: Option<u32>,
    /// Keep a file of metrics up to date, for the textfile collector of `node_exporter`
    #[arg(long, env = "PAIRMASK_METRICS_FILE", value_name = "FILE")]
    metrics_file: Option<PathBuf>,
    /// Record what clients send, and a digest of each answer, in a file for `replay`. A recording of that name is
    /// replaced
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// The most that is recorded: then the recording ends, and the daemon serves on [default: 1G]
    #[arg(long, value_name = "SIZE", requires = "record")]
    record_max: Option<FileSize>,
    /// Log system calls that a fence would refuse, and make them. A worker has it from its environment.
    #[arg(long, hide = true, env = "PAIRMASK_SECCOMP_LOG", value_parser = FalseyValueParser::new())]
    seccomp_log: bool,
    /// Serve in this process, as long as its parent is the supervisor of this id: what a supervisor
    /// starts.
    #[arg(long, value_parser = whole_number::<u32>, hide = true, value_name = "PID")]
    worker: Option<u32>,
    /// The worker takes the place of one that has served.
    #[arg(long, hide = true)]
    restarted: bool,
    /// End with the process of this id, and take the runtime directory along.
    #[arg(long, value_parser = whole_number::<u32>, hide = true, value_name = "PID")]
    private_to: Option<u32>,
}

impl Serve {
    pub const fn is_worker(&self) -> bool {
        self.worker.is_some()
    }

    /// Serves until asked to stop. `alter_answers` is for tests of the auditor.
    pub fn run(
        &self,
        common: &CommonOptions,
        alter_answers: Option<AlterAnswer>,
    ) -> Result<(), ServeError> {
        let settings = ServeSettings { alter_answers, ..self.settings(common) };
        if let Some(supervisor) = self.worker {
            return work(&settings, supervisor);
        }
        match self.private_to {
            None => {
                let _metrics = self.metrics(common, &settings)?;
                supervise(&settings)
            }
            Some(owner) => spawn::serve_private(&settings, owner),
        }
    }

    /// What keeps the file of metrics, if there is to be one: the supervisor, since the worker may write nowhere else.
    fn metrics(
        &self,
        common: &CommonOptions,
        settings: &ServeSettings,
    ) -> Result<Option<MetricsFile>, ServeError> {
        let path = self.metrics_file.as_ref().or(common.file.metrics_file.as_ref());
        let path = path.filter(|path| !path.as_os_str().is_empty()).cloned();
        let (dir, name) = (&settings.dir, &settings.instance);
        path.map(|path| MetricsFile::start(path, dir.clone(), name.clone())).transpose()
    }

    fn settings(&self, common: &CommonOptions) -> ServeSettings {
        let default = DaemonSettings::default();
        let spin_us = self.spin_us.or(common.file.spin_us);
        let gpu_awake_ms = self.gpu_awake_ms.or(common.file.gpu_awake_ms);
        let group = self.allow_group.or(common.file.allow_group);
        let probe_ms = self.probe_ms.or(common.file.probe_ms);
        let max_clients = self.max_clients.or(common.file.max_clients);
        let max_reply_mib = self.max_reply_mib.or(common.file.max_reply_mib);
        let max_memory = self.max_memory.or(common.file.max_memory);
        let Limits { max_clients: clients, max_reply_bytes, max_memory_bytes } = default.limits;
        let limits = Limits {
            max_clients: max_clients.map_or(clients, |n| usize::from(n.get())),
            max_reply_bytes: max_reply_mib.map_or(max_reply_bytes, |n| u64::from(n.get()) << 20),
            max_memory_bytes: max_memory.map_or(max_memory_bytes, |size| size.0),
        };
        ServeSettings {
            instance: common.instance(),
            dir: common.runtime_dir().with_group(group.map(|group| group.0)),
            daemon: DaemonSettings {
                limits,
                threads: self.threads.or(common.file.threads),
                spin: spin_us.map_or(default.spin, Duration::from_micros),
                gpu: self.options.gpus(common),
                gpu_awake: gpu_awake_ms.map(|ms| Duration::from_millis(ms.into())),
                isa: common.isa(),
                audit: self.audit.or(common.file.audit).unwrap_or_default(),
                without_fences: self
                    .without_fence
                    .or(common.file.without_fence)
                    .unwrap_or_default(),
                probe_interval: probe_ms
                    .map_or(default.probe_interval, |ms| Duration::from_millis(ms.into())),
            },
            record: self.record.as_ref().map(|file| RecordSettings {
                file: file.clone(),
                most_bytes: self.record_max.map_or(DEFAULT_RECORD_BYTES, |size| size.0),
            }),
            restarted: self.restarted,
            refusal: if self.seccomp_log { Refusal::Logged } else { Refusal::Fails },
            alter_answers: None,
            watch_devices: None,
        }
    }
}
