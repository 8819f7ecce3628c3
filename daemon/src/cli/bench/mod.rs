//! `bench`: what frames cost on this machine.

mod report;

pub use self::report::{CpuUsed, Figures, LatencyRow};

use std::fmt;
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand, ValueEnum};
use pairmask::{Backend, SessionBuilder};
use pairmask_core::BoxCount;
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::{Deserialize, Serialize};

use self::report::LatencyReport;
use super::machine::Machine;
use super::object_files::BoxFile;
use super::options::{CommonOptions, CullFlags, DaemonOptions};
use super::output::{print_json, print_text};
use super::program::{Result, WrongUsage};
use super::progress::{progress_bar, spinner};
use super::scene_look;
use super::target::Target;
use super::whole_number::whole_number;
use crate::daemon_cpu::{DaemonCpu, own_cpu};
use crate::precision::PrecisionChoice;
use crate::scene::{Scene, SceneName};
use crate::serve::DEFAULT_SPIN;
use crate::timed_client::{Decoding, TimedClient};

#[derive(Debug, Subcommand)]
pub enum Bench {
    Latency(Latency),
}

/// Spin time of both sides. Longer than any pause between two frames, so that no thread sleeps.
const SPIN: Duration = Duration::from_secs(1);
pub const SEED: u64 = 1;
/// Frames between two moves of the progress bar, which cost nothing beside those.
const FRAMES_PER_TICK: u64 = 64;

/// What frames are timed, and how they are culled and decoded.
#[derive(Debug, Args)]
pub struct FramesOf {
    #[command(flatten)]
    pub options: CullFlags,
    #[command(flatten)]
    pub daemon: DaemonOptions,
    /// Numbers of boxes of a uniform scene with about one pair a box
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [1000, 4096, 10_000])]
    pub n: Vec<u32>,
    /// File of boxes instead, each then moving 2 % of its size a frame
    #[arg(long, value_name = "FILE", conflicts_with = "n")]
    pub scene: Option<PathBuf>,
    /// Precision of the boxes: exact, q16, q8, f16, margin=X; one row each
    #[arg(long, value_name = "MODE,..", value_delimiter = ',', default_values_t = [PrecisionChoice::Exact])]
    pub precision: Vec<PrecisionChoice>,
    /// Threads of a client: they look at the pairs of a mask, and write exact boxes
    #[arg(long, value_parser = whole_number::<NonZeroUsize>, value_name = "N", default_value = "1")]
    pub decode_threads: NonZeroUsize,
}

/// Latency of frames by stage, of one client in a closed loop
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
The table says who answered, and what CPU time a frame takes of both processes: a side that spins takes
that too.

Examples:
  pairmaskd bench latency --n 1000,4096,10000 --pin
  pairmaskd bench latency --scene boxes.f32 --wait spin,event --json
  pairmaskd bench latency --backend in-process --engine cpu-brute --threads 1

Clients at a pace, several at a time or of differing sizes: `pairmask-lab load` (tests/lab).")]
pub struct Latency {
    #[command(flatten)]
    frames_of: FramesOf,
    /// Frames that are measured
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "2000")]
    frames: NonZeroU64,
    /// Frames before those [default: a fifth of them, at least 20]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N")]
    warm_up: Option<u64>,
    /// How client and daemon wait for each other: spin, event, or serve, as they do by themselves
    #[arg(long, value_name = "HOW,..", value_delimiter = ',', default_values_t = [Wait::Spin])]
    wait: Vec<Wait>,
    /// Keep the client and the daemon's serving thread on a core each (not with in-process)
    #[arg(long)]
    pin: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
pub enum Wait {
    /// Both spin and hold a core each
    Spin,
    /// Both sleep without spinning, and are woken
    Event,
    /// As `serve` and sessions do unless set otherwise
    Serve,
}

impl Wait {
    pub const fn spin(self) -> Duration {
        match self {
            Self::Spin => SPIN,
            Self::Event => Duration::ZERO,
            Self::Serve => DEFAULT_SPIN,
        }
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.to_possible_value().map_or(Ok(()), |value| f.write_str(value.get_name()))
    }
}

impl Latency {
    pub fn run(&self, common: &CommonOptions) -> Result {
        let is_alone =
            self.frames_of.options.backend(common, Backend::Daemon) == Backend::InProcess;
        if self.pin && is_alone {
            let what =
                "--pin keeps a daemon on a core of its own: leave it out with --backend in-process";
            return Err(WrongUsage(what.to_owned()).into());
        }
        let machine = Machine::this();
        let report = LatencyReport { machine, rows: self.rows(common)? };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    fn rows(&self, common: &CommonOptions) -> Result<Vec<LatencyRow>> {
        let making = spinner("making scenes");
        let scenes = self.scenes()?;
        making.finish_and_clear();
        // Before any thread is pinned: threads that start later inherit its cores.
        let decoding = Decoding::start(self.frames_of.decode_threads)?;
        let cores = self.pin.then(Cores::of_this_thread).transpose()?;
        let mut rows = Vec::new();
        for wait in &self.wait {
            if let Some(cores) = &cores {
                // The daemon of this wait must not inherit the client's one core.
                cores.unpin()?;
            }
            let FramesOf { options, daemon, .. } = &self.frames_of;
            let target = Target::new(options, daemon, wait.spin(), 1, common)?;
            if let Some(cores) = &cores {
                cores.pin(&target.dir, &target.instance)?;
            }
            for scene in &scenes {
                for precision in &self.frames_of.precision {
                    let session = target.session(options.session(common), wait.spin());
                    let (scene, cpu) = (scene.clone(), target.cpu());
                    let row = self.row(scene, *precision, *wait, &decoding, session, cpu.as_ref());
                    rows.push(row?);
                }
            }
        }
        Ok(rows)
    }

    fn scenes(&self) -> Result<Vec<Scene>> {
        if let Some(path) = &self.frames_of.scene {
            let boxes = BoxFile::open(path)?.read()?;
            if let Some(warning) = scene_look::of_boxes(&boxes) {
                log::warn!("{}: {warning}", path.display());
            }
            return Ok(vec![Scene::from_boxes(boxes, SEED)]);
        }
        let uniform = |n: &u32| Scene::new(SceneName::Uniform, *n as usize, SEED);
        Ok(self.frames_of.n.iter().map(uniform).collect())
    }

    /// The measured loop: it holds only the frame and the clock.
    fn row(
        &self,
        mut scene: Scene,
        precision: PrecisionChoice,
        wait: Wait,
        decoding: &Decoding,
        session: SessionBuilder,
        daemon: Option<&DaemonCpu>,
    ) -> Result<LatencyRow> {
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        let decode_threads = self.frames_of.decode_threads.get();
        let session =
            session.capacity(BoxCount::new(n)).iterate_threads(decode_threads).connect()?;
        let mut client = TimedClient::new(session, precision, scene.boxes());
        // Before the first recorded frame memory is touched, estimates settle, clocks rise.
        let warm_up = self.warm_up.unwrap_or_else(|| (self.frames.get() / 5).max(20));
        let frames = warm_up + self.frames.get();
        let progress = progress_bar(frames, &format!("{n} boxes, {precision}, {wait}"));
        // The backend of this frame has to serve all frames.
        let first = client.frame(scene.boxes(), decoding, |_| ())?;
        let mut figures = Figures::of(&first.info);
        let mut used = (None, own_cpu());
        for frame in 0..frames {
            scene.step();
            if frame == warm_up {
                used = (daemon.map(DaemonCpu::watch), own_cpu());
            }
            let answered = client.frame(scene.boxes(), decoding, |_| ())?;
            if frame >= warm_up {
                figures.record(&answered)?;
            }
            if frame.is_multiple_of(FRAMES_PER_TICK) {
                progress.set_position(frame);
            }
        }
        let (daemon, client) = used;
        let (daemon, client) = (daemon.map(|used| used()), own_cpu().saturating_sub(client));
        let cpu = CpuUsed { daemon, client: Some(client), frames: figures.frames };
        progress.finish_and_clear();
        Ok(LatencyRow { n, precision, wait, decode_threads, figures, cpu })
    }
}

/// Cores that this process could use when it started.
struct Cores {
    all: CpuSet,
    client: usize,
    daemon: usize,
}

impl Cores {
    /// The cores of the calling thread, which must not be pinned yet.
    fn of_this_thread() -> Result<Self> {
        let all = sched_getaffinity(None).map_err(pinning)?;
        let mut cores = (0..CpuSet::MAX_CPU).filter(|core| all.is_set(*core));
        let two = cores.next().zip(cores.next());
        let (client, daemon) = two.ok_or(
            "--pin needs two cores, one for the client and one for the daemon: leave it out",
        )?;
        Ok(Self { all, client, daemon })
    }

    /// Gives the calling thread all cores back: a process that it starts inherits them.
    fn unpin(&self) -> Result {
        Ok(sched_setaffinity(None, &self.all).map_err(pinning)?)
    }

    /// Keeps the calling thread on one core, and the thread that serves the instance on another.
    fn pin(&self, dir: &RuntimeDir, instance: &InstanceName) -> Result {
        // The serving thread is its process's first, so it has the process's number. The engines'
        // other threads stay free.
        let serving = dir
            .serving(instance)
            .read_record(instance)
            .and_then(|record| Pid::from_raw(i32::try_from(record.worker_pid).ok()?))
            .ok_or_else(|| format!("--pin: no daemon serves instance '{instance}'"))?;
        sched_setaffinity(Some(serving), &only(self.daemon)).map_err(pinning)?;
        Ok(sched_setaffinity(None, &only(self.client)).map_err(pinning)?)
    }
}

fn pinning(error: rustix::io::Errno) -> String {
    format!("--pin: {error}")
}

fn only(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}
