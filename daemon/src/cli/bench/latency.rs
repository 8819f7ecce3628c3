//! `bench latency`: one client in a closed loop, frame after frame, each stage by itself.

use std::fmt;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use pairmask::engine::UnknownName;
use pairmask::session::{ConnectError, FrameError, SessionBuilder, WaitError};
use pairmask::transport::{InstanceName, RuntimeDir};
use pairmask::{Backend, BoxCount};

use super::closed_loop::{self, Lengths};
use super::machine::Machine;
use super::pin::{Cores, PinError};
use super::report::{LatencyReport, Row};
use crate::cli::config::Config;
use crate::cli::options::{CullOptions, DaemonOptions, Place};
use crate::cli::output::{OutputError, print_json, print_text, progress_bar};
use crate::cli::raw_boxes::{RawBoxes, RawBoxesError};
use crate::scene::{Scene, SceneName};
use crate::spawn::{PrivateDaemon, PrivateSettings, SpawnError};
use crate::study::grid::GridError;
use crate::study::mapping::MappingError;

/// Longer than any pause between two frames: whoever spins never sleeps in between.
const SPIN: Duration = Duration::from_secs(1);
/// How long one frame may take: all pairs of a million boxes on one thread.
const DEADLINE: Duration = Duration::from_secs(600);
/// The scene's seed: every run sees the same boxes move the same way.
const SEED: u64 = 1;

/// Latency of frames in a closed loop, by stage
#[derive(Debug, Args)]
#[command(after_help = "\
The boxes move from frame to frame, untimed. Stages of a frame:
  fill        memory borrowed and the boxes written into it
  round trip  boxes submitted to mask in hand
  engine      the engine's own part of the round trip
  added       the rest of the round trip: the way there and back
  decode      every pair of the mask looked at once
  total       fill, round trip and decode

A daemon is started for the measurement unless an instance is named.

Examples:
  pairmaskd bench latency --n 1000,4096,10000 --pin
  pairmaskd bench latency --scene boxes.f32 --wait spin,event --json
  pairmaskd bench latency --backend in-process --engine cpu-brute --threads 1")]
pub struct Latency {
    #[command(flatten)]
    options: CullOptions,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Numbers of boxes of a uniform scene with about one pair a box
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_values_t = [1000, 4096, 10_000])]
    n: Vec<u32>,
    /// File of boxes instead, each then moving 2 % of its size a frame
    #[arg(long, value_name = "FILE", conflicts_with = "n")]
    scene: Option<PathBuf>,
    /// Frames that are measured
    #[arg(long, value_name = "N", default_value = "2000")]
    frames: NonZeroU64,
    /// Frames before those [default: a fifth of them, at least 20]
    #[arg(long, value_name = "N")]
    warm_up: Option<u64>,
    /// How client and daemon wait for each other: spin, event
    #[arg(long, value_name = "HOW,..", value_delimiter = ',', default_values_t = [Wait::Spin])]
    wait: Vec<Wait>,
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
    /// Both hold a core.
    Spin,
    /// Both sleep at once, and are woken.
    Event,
}

impl Wait {
    const ALL: [Self; 2] = [Self::Spin, Self::Event];

    /// How long whoever waits spins.
    const fn spin(self) -> Duration {
        match self {
            Self::Spin => SPIN,
            Self::Event => Duration::ZERO,
        }
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Spin => "spin",
            Self::Event => "event",
        })
    }
}

impl FromStr for Wait {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        Self::ALL
            .into_iter()
            .find(|wait| wait.to_string() == s)
            .ok_or_else(|| UnknownName { name: s.to_owned(), known: "spin, event" })
    }
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error(transparent)]
    Boxes(#[from] RawBoxesError),
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error(transparent)]
    Wait(#[from] WaitError),
    #[error(transparent)]
    Pin(#[from] PinError),
    /// The daemon died, or came, in the middle: the row would mix two things.
    #[error("the daemon came or went during the measurement: name a --backend, and try again")]
    Changed,
    /// An engine is broken.
    #[error("frame {frame} has {counted} pairs and its mask holds {decoded}: please report this")]
    Miscounted { frame: u64, counted: u64, decoded: u64 },
    #[error(transparent)]
    Mapping(#[from] MappingError),
    #[error(transparent)]
    Grid(#[from] GridError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Where the daemon of a measurement is, if there is one.
struct Target {
    dir: RuntimeDir,
    instance: InstanceName,
    backend: Backend,
    /// Stopped with the measurement.
    _daemon: Option<PrivateDaemon>,
}

impl Latency {
    /// Measures a row for every wait and scene, and prints them.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        let scenes = self.scenes()?;
        // Before any thread is pinned: it counts the cores that may be used.
        let machine = Machine::this();
        let cores = self.pin.then(Cores::of_this_thread).transpose()?;
        let mut rows = Vec::new();
        for wait in &self.wait {
            if let Some(cores) = &cores {
                // The daemon of this wait must not inherit the client's one core.
                cores.unpin()?;
            }
            let target = self.target(*wait, place, config)?;
            if let Some(cores) = &cores {
                cores.pin(&target.dir, &target.instance)?;
            }
            for scene in &scenes {
                rows.push(self.row(scene.clone(), *wait, &target, config)?);
            }
        }
        let report = LatencyReport { machine, rows };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    fn scenes(&self) -> Result<Vec<Scene>, BenchError> {
        if let Some(path) = &self.scene {
            let boxes = RawBoxes::open(path)?.read()?;
            return Ok(vec![Scene::from_boxes(boxes, SEED)]);
        }
        let uniform = |n: &u32| Scene::new(SceneName::Uniform, *n as usize, SEED);
        Ok(self.n.iter().map(uniform).collect())
    }

    /// The instance that was named, else a daemon that waits as it is asked to.
    fn target(&self, wait: Wait, place: &Place, config: &Config) -> Result<Target, SpawnError> {
        let backend = self.options.backend(config, Backend::Daemon);
        let named = place.named_instance(config);
        if backend == Backend::Daemon && named.is_none() {
            let settings = PrivateSettings { spin: wait.spin(), ..self.daemon.private(config) };
            let daemon = PrivateDaemon::start_self(&settings)?;
            let (dir, instance) = (daemon.dir(), daemon.instance());
            return Ok(Target { dir, instance, backend, _daemon: Some(daemon) });
        }
        let (dir, instance) = (place.runtime_dir(config), named.unwrap_or_default());
        Ok(Target { dir, instance, backend, _daemon: None })
    }

    fn row(
        &self,
        scene: Scene,
        wait: Wait,
        target: &Target,
        config: &Config,
    ) -> Result<Row, BenchError> {
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        let mut session = self.session(n, wait, target, config).connect()?;
        let frames = self.frames.get();
        let warm_up = self.warm_up.unwrap_or_else(|| (frames / 5).max(20));
        let progress = progress_bar(warm_up + frames, &format!("{n} boxes, {wait}"));
        let lengths = Lengths { warm_up, frames };
        let measured = closed_loop::measure(&mut session, scene, &lengths, &progress)?;
        progress.finish_and_clear();
        Ok(Row::new(n, wait, frames, &measured))
    }

    fn session(&self, n: u32, wait: Wait, target: &Target, config: &Config) -> SessionBuilder {
        self.options
            .session(config)
            .runtime_dir(target.dir.clone())
            .instance(target.instance.as_str())
            .backend(target.backend)
            .spin(wait.spin())
            .deadline(DEADLINE)
            .capacity(BoxCount::new(n))
    }
}
