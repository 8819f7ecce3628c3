//! `stress`: hard scenes, every engine against the oracle, in process or as clients of a daemon.

use std::num::{NonZeroU16, NonZeroU32, NonZeroUsize};
use std::time::Duration;

use clap::Args;
use clap::builder::PossibleValuesParser;
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use pairmaskd::audit::AuditRate;
use pairmaskd::cli::options::{CommonOptions, DaemonOptions};
use pairmaskd::cli::output::{print_json, print_text};
use pairmaskd::cli::progress::progress_bar;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::PrivateDaemon;

use crate::Result;
use crate::processes::Daemon;
use crate::sabotage::Sabotage;
use crate::stress::clients::{ClientSettings, ClientsRun, limits};
use crate::stress::{MOST_FAILURES, Requested, Roster, StressReport, clock_seed, run};

/// Put every engine through hard scenes and compare with a naive oracle
#[derive(Debug, Args)]
#[command(after_help = "\
Scenes are drawn to go wrong: the ends of f32, faces that touch or lie an ulp apart, NaN, empty and flat
boxes, borders of cells and of quantisation, spheres that touch, and mixtures of those. Every engine,
instruction set and encoding answers each, and every engine in every precision mode: what overlaps must
be found, what the mode's definition adds may be, no farther apart than the mode states. All threads have
any rounding modes and denormal flags. What an engine leaves to another one, because too many boxes stand
in one place, is counted as skipped.

With --clients the scenes go as frames of so many client processes, at the same time, through a daemon
that is started for the run and audits every frame, or through a running one (--instance; it needs
--max-clients of 3 a client and 32 more).
The run fails too where a frame is lost, the daemon's audit finds a wrong pair, or the daemon does
not serve on.

Examples:
  pairmask-lab stress --seconds 600
  pairmask-lab stress --engine cpu-grid,gpu-grid --gpu software
  pairmask-lab stress --mode q8,f16                 these modes and not the exact engines
  pairmask-lab stress --case 12345                  one case again
  pairmask-lab stress --clients 8 --kills           eight clients of a daemon, killed now and then

Exit status: 0 where every answer was right, 1 where one was not.")]
pub struct Stress {
    /// Seed of the run: the same cases in the same order [default: from the clock]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", conflicts_with = "case")]
    seed: Option<u64>,
    /// This case and no other
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N")]
    case: Option<u64>,
    /// How long
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N", default_value_t = 10)]
    seconds: u64,
    /// Engines, spheres, persistent scenes (of --clients); several with commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "all",
        value_parser = PossibleValuesParser::new(Requested::engine_names()))]
    engine: Vec<String>,
    /// Precision modes; several with commas. All but engines of boxes are exact
    #[arg(long, value_name = "MODES", value_delimiter = ',', default_value = "all",
        value_parser = PossibleValuesParser::new(Requested::MODES))]
    mode: Vec<String>,
    /// Most threads of an engine [default: all]
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Client processes of a daemon, which send the scenes as frames
    #[arg(long, value_parser = whole_number::<NonZeroU16>, value_name = "N")]
    clients: Option<NonZeroU16>,
    /// Kill a client now and then, and start it again; close sessions with frames under way
    #[arg(long, requires = "clients")]
    kills: bool,
    #[command(flatten)]
    options: DaemonOptions,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Break every engine (`lossy`) or mode (`inward`), to test that the checks notice.
    #[arg(long, hide = true, num_args = 0..=1, require_equals = true, default_missing_value = "lossy", conflicts_with = "clients")]
    break_engine: Option<Sabotage>,
}

/// The daemon of client processes: that which the user named, else one of this run.
pub(super) struct ClientsDaemon {
    pub(super) dir: RuntimeDir,
    pub(super) instance: InstanceName,
    _started: Option<PrivateDaemon>,
}

impl ClientsDaemon {
    /// One that is started audits one frame in so many.
    pub(super) fn new(
        clients: NonZeroU16,
        audited_one_in: NonZeroU32,
        options: &DaemonOptions,
        common: &CommonOptions,
    ) -> Result<Self> {
        if let Some(instance) = common.named_instance() {
            return Ok(Self { dir: common.runtime_dir(), instance, _started: None });
        }
        let settings = DaemonSettings {
            limits: limits(clients),
            audit: AuditRate::OneIn(audited_one_in),
            ..options.private(common)
        };
        let started = PrivateDaemon::start(&std::env::current_exe()?, &settings)?;
        let (dir, instance) = (started.dir(), started.instance());
        Ok(Self { dir, instance, _started: Some(started) })
    }
}

impl Stress {
    pub fn run(&self, common: &CommonOptions) -> Result<()> {
        let report = match self.clients {
            Some(clients) => self.with_clients(clients, common)?,
            None => self.in_process(common)?,
        };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        if report.is_clean() {
            return Ok(());
        }
        let unsound = "no answer was wrong, but the clients, the daemon or its audit were not as they should be";
        let wrong = "wrong answers: each can be had again with the command beside it";
        let is_unsound = report.failures.is_empty() && report.clients.is_some();
        Err(if is_unsound { unsound } else { wrong }.into())
    }

    fn in_process(&self, common: &CommonOptions) -> Result<StressReport> {
        let roster = Roster {
            requested: self.requested(),
            gpu: self.options.gpu(common),
            sabotage: self.break_engine,
        };
        let time = self.case.is_none().then(|| Duration::from_secs(self.seconds));
        let mut subjects = roster.subjects()?;
        let bar = progress_bar(self.seconds, "hard scenes");
        let report = run(self.seed(), time, &mut subjects, |count, time| {
            bar.set_position(time.as_secs());
            bar.set_message(format!("{count} cases"));
        });
        bar.finish_and_clear();
        Ok(report)
    }

    fn with_clients(&self, clients: NonZeroU16, common: &CommonOptions) -> Result<StressReport> {
        let daemon = ClientsDaemon::new(clients, NonZeroU32::MIN, &self.options, common)?;
        let Requested { engines, modes, threads } = self.requested();
        let (engines, modes) = (engines.join(","), modes.join(","));
        let replay = format!(
            "pairmask-lab stress --clients {clients} --seconds {} \
             --engine {engines} --mode {modes} --threads {threads}{} {}",
            self.seconds,
            if self.kills { " --kills" } else { "" },
            match common.named_instance() {
                Some(instance) => format!("--instance {instance}"),
                None => format!("--gpu '{}'", self.options.gpu(common)),
            }
        );
        let run = ClientsRun {
            clients,
            daemon: Daemon::new(&daemon.dir, &daemon.instance, common.isa()),
            settings: ClientSettings {
                seed: self.seed(),
                case: self.case,
                requested: self.requested(),
                with_gpu: false,
                is_abrupt: self.kills,
                pace: None,
            },
            time: Duration::from_secs(self.seconds),
            most_failures: MOST_FAILURES,
            replay,
        };
        let bar = progress_bar(self.seconds, "hard scenes");
        let report = run.run(|crowd, time| {
            bar.set_position(time.as_secs());
            bar.set_message(format!("{} answers", crowd.answers()));
            Ok(if self.kills { crowd.kill_at_times() } else { Ok(()) }?)
        })?;
        bar.finish_and_clear();
        Ok(report)
    }

    fn requested(&self) -> Requested {
        let threads = self.threads.or(std::thread::available_parallelism().ok());
        let (engines, modes) = (self.engine.clone(), self.mode.clone());
        Requested { engines, modes, threads: threads.map_or(1, usize::from) }
    }

    /// The seed of the run or of the one case; by default from the clock.
    fn seed(&self) -> u64 {
        self.case.or(self.seed).unwrap_or_else(clock_seed)
    }
}
