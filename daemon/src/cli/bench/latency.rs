//! `bench latency`: frames of one client in a closed loop, or of clients at a pace, each stage by
//! itself.

use std::fmt;
use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::process::Command;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use pairmask::{Backend, ConnectError, SessionBuilder};
use pairmask_core::BoxCount;
use pairmask_core::engine::UnknownName;

use super::closed_loop::{self, Lengths};
use super::load::{AskedError, Case, LoadFlags};
use super::pin::{Cores, PinError};
use super::report::{IdleRow, LatencyReport, LatencyRow};
use crate::cli::config::Config;
use crate::cli::daemon_cpu::DaemonCpu;
use crate::cli::machine::Machine;
use crate::cli::options::{CullFlags, DaemonOptions, Place};
use crate::cli::output::{OutputError, print_json, print_text, progress_bar, spinner};
use crate::cli::raw_objects::{RawBoxes, RawObjectsError};
use crate::cli::scene_look;
use crate::cli::target::Target;
use crate::cli::whole_number::whole_number;
use crate::precision::PrecisionChoice;
use crate::scene::{Scene, SceneName};
use crate::serve::DEFAULT_SPIN;
use crate::spawn::{SpawnError, own_binary};
use crate::timed_client::{Decoders, Decoding, TimedClient, TimedError};

/// Spin time of both sides. Longer than any pause between two frames, so that no thread sleeps.
const SPIN: Duration = Duration::from_secs(1);
/// Seed of the scene: every run has the same boxes and motions.
pub(super) const SEED: u64 = 1;

/// Latency of frames by stage, of one client in a closed loop or of clients at a pace
#[derive(Debug, Args)]
#[command(after_help = "\
The boxes move from frame to frame, untimed. Times of a frame, the whole first, then its parts:
  total         fill and answer
    fill        memory borrowed and the boxes written into it
    answer      boxes submitted to every pair looked at
      round trip  boxes submitted to mask in hand
        engine    the engine's own part of the round trip
        added     the rest of the round trip: the way there and back
      decode      every pair of the mask looked at once
With --precision, writing the boxes in their form is part of fill. With margin=X, looking whether
boxes have moved, inflating and writing them is part of the round trip.

With --rate, --clients or --mix, clients are processes that start together. A frame of a paced
client is due at its time, and `from due` counts from then: after a stall, the frames that were due
meanwhile count their waiting too. Each row says what the daemon used of a core, and the last line
what it uses while its clients send nothing.

--backend daemon, the default, starts a daemon for the measurement unless an instance is named. auto
takes the daemon that serves the instance, and this process where none does; in-process needs none.
The table says who answered.

Examples:
  pairmaskd bench latency --n 1000,4096,10000 --pin
  pairmaskd bench latency --scene boxes.f32 --wait spin,event --json
  pairmaskd bench latency --backend in-process --engine cpu-brute --threads 1
  pairmaskd bench latency --rate closed,60,240,1000 --n 1000,10000
  pairmaskd bench latency --clients 1,2,4,8 --n 1000 --instance world
  pairmaskd bench latency --mix 1000x7,1000000x1 --seconds 10")]
pub struct Latency {
    #[command(flatten)]
    options: CullFlags,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Numbers of boxes of a uniform scene with about one pair a box
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1000, 4096, 10_000])]
    n: Vec<u32>,
    /// File of boxes instead, each then moving 2 % of its size a frame
    #[arg(long, value_name = "FILE", conflicts_with = "n")]
    scene: Option<PathBuf>,
    /// Precision of the boxes: exact, q16, q8, f16, margin=X; one row each
    #[arg(long, value_name = "MODE,..", value_delimiter = ',', default_values_t = [PrecisionChoice::Exact])]
    precision: Vec<PrecisionChoice>,
    /// Frames that are measured
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "2000")]
    frames: NonZeroU64,
    /// Frames before those [default: a fifth of them, at least 20]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N")]
    warm_up: Option<u64>,
    /// Threads of the client: they look at the pairs of a mask, and write exact boxes
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N", default_value = "1")]
    decode_threads: NonZeroUsize,
    /// How client and daemon wait for each other: spin, event, or serve, as they do by themselves
    /// [default: spin; serve with --rate, --clients or --mix]
    #[arg(long, value_name = "HOW,..", value_delimiter = ',')]
    wait: Vec<Wait>,
    #[command(flatten)]
    load: LoadFlags,
    /// Keep the client and the daemon's serving thread on a core each (not with in-process)
    #[arg(long)]
    pin: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// How the two sides wait for each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Both spin and hold a core each.
    Spin,
    /// Both sleep without spinning, and are woken.
    Event,
    /// As `serve` and sessions do unless told otherwise.
    Serve,
}

impl Wait {
    const ALL: [Self; 3] = [Self::Spin, Self::Event, Self::Serve];

    /// How long a waiting thread spins.
    pub(super) const fn spin(self) -> Duration {
        match self {
            Self::Spin => SPIN,
            Self::Event => Duration::ZERO,
            Self::Serve => DEFAULT_SPIN,
        }
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Spin => "spin",
            Self::Event => "event",
            Self::Serve => "serve",
        })
    }
}

impl FromStr for Wait {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL
            .into_iter()
            .find(|wait| wait.to_string() == s)
            .ok_or_else(|| UnknownName { name: s.to_owned(), known: "spin, event, serve".into() })
    }
}

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error(transparent)]
    Boxes(#[from] RawObjectsError),
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Timed(#[from] TimedError),
    #[error(transparent)]
    Pin(#[from] PinError),
    /// The daemon died or started during the measurement: the row would mix two backends.
    #[error("the daemon came or went during the measurement: name a --backend, and try again")]
    Changed,
    /// There is no daemon to pin.
    #[error("--pin keeps a daemon on a core of its own: leave it out with --backend in-process")]
    PinAlone,
    /// What a load consists of contradicts itself.
    #[error(transparent)]
    Asked(#[from] AskedError),
    /// A closed loop of one client is measured by frames.
    #[error("--seconds is for --rate, --clients and --mix: add one of them, or use --frames")]
    SecondsAlone,
    /// A client measured nothing.
    #[error("no frame began within the measured time: give more --seconds than {seconds}")]
    NoFrame { seconds: NonZeroU32 },
    /// A client process failed.
    #[error("a client process failed: {why}")]
    Client { why: String },
    /// Client processes cannot be started, or talked to.
    #[error("the client processes: {source}")]
    Clients { source: std::io::Error },
    /// The system started no decoding threads.
    #[error("the decoding threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl BenchError {
    /// Whether the command line is wrong.
    pub const fn is_usage(&self) -> bool {
        matches!(self, Self::PinAlone | Self::Asked(_) | Self::SecondsAlone)
    }
}

impl Latency {
    /// Measures a row for every wait, scene and precision, and prints them.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        self.check(config)?;
        let machine = Machine::this();
        let mut report = LatencyReport { machine, rows: Vec::new(), idle: Vec::new() };
        if self.load.is_asked() {
            self.run_load(place, config, &mut report)?;
        } else {
            report.rows = self.run_alone(place, config)?;
        }
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    /// One client in a closed loop, in this process.
    fn run_alone(&self, place: &Place, config: &Config) -> Result<Vec<LatencyRow>, BenchError> {
        let making = spinner("making scenes");
        let scenes = self.scenes()?;
        making.finish_and_clear();
        // Before any thread is pinned: threads that start later inherit its cores.
        let mut decoding = threads_of(self.decode_threads)?;
        let cores = self.pin.then(Cores::of_this_thread).transpose()?;
        let mut rows = Vec::new();
        for wait in self.waits(Wait::Spin) {
            if let Some(cores) = &cores {
                // The daemon of this wait must not inherit the client's one core.
                cores.unpin()?;
            }
            let target = Target::new(&self.options, &self.daemon, wait.spin(), place, config)?;
            if let Some(cores) = &cores {
                cores.pin(&target.dir, &target.instance)?;
            }
            for scene in &scenes {
                for precision in &self.precision {
                    let builder = self.options.session(place, config);
                    let session = target.session(builder, wait.spin());
                    rows.push(self.row(
                        scene.clone(),
                        *precision,
                        wait,
                        &mut decoding,
                        session,
                        target.cpu().as_ref(),
                    )?);
                }
            }
        }
        Ok(rows)
    }

    /// Client processes.
    fn run_load(
        &self,
        place: &Place,
        config: &Config,
        report: &mut LatencyReport,
    ) -> Result<(), BenchError> {
        let cases = self.load.cases(&self.sizes()?);
        for wait in self.waits(Wait::Serve) {
            let most_clients = self.load.most_clients();
            let target = Target::for_clients(
                &self.options,
                &self.daemon,
                wait.spin(),
                most_clients,
                place,
                config,
            )?;
            let runs = cases.iter().flat_map(|case| self.precision.iter().map(move |p| (case, *p)));
            let runs: Vec<(&Case, PrecisionChoice)> = runs.collect();
            for (i, (case, precision)) in runs.iter().enumerate() {
                let daemon = target.cpu();
                let is_last = i + 1 == runs.len();
                let client = || self.client(&target, *precision, wait, place, config);
                let what = format!("{} of {}", i + 1, runs.len());
                let found = self.load.run(case, client, daemon.as_ref(), is_last, &what)?;
                report.idle.extend(found.idle_percent.map(|daemon_cpu_percent| IdleRow {
                    wait: wait.to_string(),
                    clients: case.groups.iter().map(|group| group.clients).sum(),
                    daemon_cpu_percent,
                }));
                for group in &found.groups {
                    let n = group.group.n;
                    let row = LatencyRow::new(n, *precision, wait, &group.figures)
                        .decoded_by(self.decode_threads.get())
                        .of_daemon(found.daemon_percent);
                    report.rows.push(row.of_load(case, group));
                }
            }
        }
        Ok(())
    }

    /// The command of a client process, without what tells it from the others.
    fn client(
        &self,
        target: &Target,
        precision: PrecisionChoice,
        wait: Wait,
        place: &Place,
        config: &Config,
    ) -> Result<Command, BenchError> {
        let options = self.options.cull_options(config);
        let mut command = Command::new(own_binary()?);
        command
            .args(["bench-client", "--config", "/dev/null"])
            .args(["--instance", target.instance.as_str()])
            .arg("--runtime-dir")
            .arg(target.dir.path())
            .args(["--isa", &place.isa(config).to_string()])
            .args(["--backend", &self.options.backend(config, Backend::Daemon).to_string()])
            .args(["--engine", &options.engine.to_string()])
            .args(["--encoding", &options.encoding.to_string()])
            .args(["--precision", &precision.to_string()])
            .args(["--wait", &wait.to_string()])
            .args(["--decode-threads", &self.decode_threads.to_string()]);
        if let Some(threads) = options.threads {
            command.args(["--threads", &threads.to_string()]);
        }
        if let Some(scene) = &self.scene {
            command.arg("--scene").arg(scene);
        }
        Ok(command)
    }

    /// Checks that the options do not contradict each other.
    fn check(&self, config: &Config) -> Result<(), BenchError> {
        self.load.check()?;
        let is_alone = self.options.backend(config, Backend::Daemon) == Backend::InProcess;
        if self.pin && is_alone { Err(BenchError::PinAlone) } else { Ok(()) }
    }

    fn waits(&self, default: Wait) -> Vec<Wait> {
        if self.wait.is_empty() { vec![default] } else { self.wait.clone() }
    }

    /// The sizes of the scenes.
    fn sizes(&self) -> Result<Vec<u32>, BenchError> {
        let Some(path) = &self.scene else { return Ok(self.n.clone()) };
        let boxes = RawBoxes::open(path)?.read()?;
        Ok(vec![u32::try_from(boxes.len()).unwrap_or(u32::MAX)])
    }

    fn scenes(&self) -> Result<Vec<Scene>, BenchError> {
        if let Some(path) = &self.scene {
            let boxes = RawBoxes::open(path)?.read()?;
            if let Some(warning) = scene_look::of_boxes(&boxes) {
                log::warn!("{}: {warning}", path.display());
            }
            return Ok(vec![Scene::from_boxes(boxes, SEED)]);
        }
        let uniform = |n: &u32| Scene::new(SceneName::Uniform, *n as usize, SEED);
        Ok(self.n.iter().map(uniform).collect())
    }

    fn row(
        &self,
        scene: Scene,
        precision: PrecisionChoice,
        wait: Wait,
        decoding: &mut Decoding,
        session: SessionBuilder,
        daemon: Option<&DaemonCpu>,
    ) -> Result<LatencyRow, BenchError> {
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        let decode_threads = self.decode_threads.get();
        let session = session.capacity(BoxCount::new(n)).visit_threads(decode_threads).connect()?;
        let mut client = TimedClient::new(session, precision, scene.boxes());
        let frames = self.frames.get();
        let warm_up = self.warm_up.unwrap_or_else(|| (frames / 5).max(20));
        let progress = progress_bar(warm_up + frames, &format!("{n} boxes, {precision}, {wait}"));
        let lengths = Lengths { warm_up, frames };
        let (figures, used) =
            closed_loop::measure(&mut client, scene, &lengths, decoding, daemon, &progress)?;
        progress.finish_and_clear();
        let row = LatencyRow::new(n, precision, wait, &figures);
        Ok(row.decoded_by(decode_threads).of_daemon(used))
    }
}

/// The threads of a client. They are kept awake while frames are under way.
pub(super) fn threads_of(threads: NonZeroUsize) -> Result<Decoding, BenchError> {
    Ok(match threads.get() {
        1 => Decoding::Serial,
        _ => Decoding::Parallel(Decoders::start(threads)?),
    })
}
