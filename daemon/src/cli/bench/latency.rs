//! `bench latency`: one client in a closed loop, frame after frame, each stage by itself.

use std::fmt;
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use pairmask::{Backend, ConnectError, SessionBuilder};
use pairmask_core::BoxCount;
use pairmask_core::engine::UnknownName;

use super::closed_loop::{self, Lengths};
use super::pin::{Cores, PinError};
use super::report::{LatencyReport, LatencyRow};
use crate::cli::config::Config;
use crate::cli::machine::Machine;
use crate::cli::options::{CullFlags, DaemonOptions, Place};
use crate::cli::output::{OutputError, print_json, print_text, progress_bar, spinner};
use crate::cli::raw_objects::{RawBoxes, RawObjectsError};
use crate::cli::scene_look;
use crate::cli::target::Target;
use crate::cli::whole_number::whole_number;
use crate::precision::PrecisionChoice;
use crate::scene::{Scene, SceneName};
use crate::spawn::SpawnError;
use crate::timed_client::{Decoders, Decoding, TimedClient, TimedError};

/// Spin time of both sides. Longer than any pause between two frames, so that no thread sleeps.
const SPIN: Duration = Duration::from_secs(1);
/// Seed of the scene: every run has the same boxes and motions.
const SEED: u64 = 1;

/// Latency of frames in a closed loop, by stage
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

--backend daemon, the default, starts a daemon for the measurement unless an instance is named. auto
takes the daemon that serves the instance, and this process where none does; in-process needs none.
The table says who answered.

Examples:
  pairmaskd bench latency --n 1000,4096,10000 --pin
  pairmaskd bench latency --scene boxes.f32 --wait spin,event --json
  pairmaskd bench latency --backend in-process --engine cpu-brute --threads 1")]
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
    /// Both spin and hold a core each.
    Spin,
    /// Both sleep without spinning, and are woken.
    Event,
}

impl Wait {
    const ALL: [Self; 2] = [Self::Spin, Self::Event];

    /// How long a waiting thread spins.
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
            .ok_or_else(|| UnknownName { name: s.to_owned(), known: "spin, event".into() })
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
    /// The system started no decoding threads.
    #[error("the decoding threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl Latency {
    /// Measures a row for every wait, scene and precision, and prints them.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        self.check(config)?;
        let making = spinner("making scenes");
        let scenes = self.scenes()?;
        making.finish_and_clear();
        // Before any thread is pinned: this counts the cores of the process, and threads that start
        // later inherit them.
        let machine = Machine::this();
        let mut decoding = self.decoding()?;
        let cores = self.pin.then(Cores::of_this_thread).transpose()?;
        let mut rows = Vec::new();
        for wait in &self.wait {
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
                        *wait,
                        &mut decoding,
                        session,
                    )?);
                }
            }
        }
        let report = LatencyReport { machine, rows };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    /// Checks that the options do not contradict each other.
    fn check(&self, config: &Config) -> Result<(), BenchError> {
        let is_alone = self.options.backend(config, Backend::Daemon) == Backend::InProcess;
        if self.pin && is_alone { Err(BenchError::PinAlone) } else { Ok(()) }
    }

    /// The threads of the client. They are kept awake while frames are under way.
    fn decoding(&self) -> Result<Decoding, BenchError> {
        Ok(match self.decode_threads.get() {
            1 => Decoding::Serial,
            _ => Decoding::Parallel(Decoders::start(self.decode_threads)?),
        })
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
    ) -> Result<LatencyRow, BenchError> {
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        let visit_threads = self.decode_threads.get();
        let session = session.capacity(BoxCount::new(n)).visit_threads(visit_threads).connect()?;
        let mut client = TimedClient::new(session, precision, scene.boxes());
        let frames = self.frames.get();
        let warm_up = self.warm_up.unwrap_or_else(|| (frames / 5).max(20));
        let progress = progress_bar(warm_up + frames, &format!("{n} boxes, {precision}, {wait}"));
        let lengths = Lengths { warm_up, frames };
        let measured = closed_loop::measure(&mut client, scene, &lengths, decoding, &progress)?;
        progress.finish_and_clear();
        let decode_threads = self.decode_threads.get();
        Ok(LatencyRow::new(n, precision, wait, frames, &measured).decoded_by(decode_threads))
    }
}
