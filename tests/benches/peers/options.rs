//! The command line.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::Parser;
use pairmask_core::EngineChoice;
use pairmask_core::engine::UnknownName;
use pairmask_tests::peers::peer_name::PeerName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::SceneName;
use rustix::time::{ClockId, clock_gettime};

/// The daemon and the in-process engines against other broad phases.
///
/// All contenders see the same frames, in one process, in turns. A turn is a few frames, the first
/// of which is not counted (the others' turns have emptied the caches), and the order rotates.
/// Boxes move 2 % of their size a frame.
///
/// Time of a frame: from the user's boxes to all pairs visited. For us: write the boxes into the
/// session's memory (also a column of its own), submit, wait, decode. For the others: update from the
/// boxes, then visit every pair. Visiting counts and sums. Sets of pairs are compared by themselves,
/// untimed.
#[derive(Debug, Parser)]
#[command(
    name = "peers",
    after_help = "\
Examples:
  cargo bench --workspace --features pairmask-tests/peers --bench peers -- --n 1000,10000
  cargo bench --workspace --features pairmask-tests/peers --bench peers -- \\
      --scene pile --n 100000 --frames 200 --peers parry-refit,parry-optimize --json
  cargo bench --workspace --features pairmask-tests/peers --bench peers -- --scene all --out target/peers

A ratio below 1 means that we are faster. A peer that misses a pair (scenes with infinite boxes)
is listed and is never the best peer. Exit status 1: our own pairs are wrong."
)]
// Four ways to print, each a flag of its own, and cargo's.
#[allow(clippy::struct_excessive_bools)]
pub struct Options {
    /// Scenes, or `all`
    #[arg(
        long,
        value_name = "NAME,..",
        value_delimiter = ',',
        default_value = "uniform,mixed,pile,plane"
    )]
    pub scene: Vec<SceneWish>,
    /// Numbers of boxes
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_values_t = [1_000, 4_096, 10_000, 100_000])]
    pub n: Vec<usize>,
    /// Frames of drift
    #[arg(long, value_name = "N", default_value_t = 200)]
    pub frames: usize,
    /// Frames of one turn; the first of a turn is not counted unless it is the only one
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub turn: usize,
    /// Numbers of threads
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_values_t = [1, 2])]
    pub threads: Vec<usize>,
    /// Peers, or `all`
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_value = "all")]
    pub peers: Vec<PeerWish>,
    /// Our engines; `auto` is the plan
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = [EngineChoice::Auto])]
    pub engine: Vec<EngineChoice>,
    /// How long the daemon spins for the next frame; no other contender is timed before it sleeps.
    /// Longer than the default of `serve` helps where cores are free, and hurts where they are not
    #[arg(long, value_name = "US", default_value_t = 50)]
    pub daemon_spin_us: u64,
    /// GPU of the daemon; none compares CPUs
    #[arg(long, value_name = "GPU", default_value_t = GpuChoice::None)]
    pub gpu: GpuChoice,
    /// What is counted: wall, or on a busy machine cpu, the time of the one thread that works (in
    /// process only, one thread only)
    #[arg(long, value_enum, default_value_t = Clock::Wall, value_name = "CLOCK")]
    pub clock: Clock,
    /// Print one JSON object a peer and line
    #[arg(long)]
    pub json: bool,
    /// Print CSV
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    /// Print Markdown
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    pub markdown: bool,
    /// Print an SVG plot
    #[arg(long, conflicts_with_all = ["json", "csv", "markdown"])]
    pub svg: bool,
    /// Write peers.jsonl, peers.csv, peers.md and peers.svg there too
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Seed of the scenes
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// The clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Clock {
    /// Wall-clock time.
    Wall,
    /// CPU time of the thread.
    Cpu,
}

impl Clock {
    /// Time since a fixed moment; with [`Clock::Cpu`] the CPU time of the calling thread.
    pub fn now(self) -> Duration {
        let id = match self {
            Self::Wall => ClockId::Monotonic,
            Self::Cpu => ClockId::ThreadCPUTime,
        };
        let time = clock_gettime(id);
        Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec as u32)
    }
}

/// One scene or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneWish {
    All,
    Only(SceneName),
}

impl FromStr for SceneWish {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "all" { Ok(Self::All) } else { s.parse().map(Self::Only) }
    }
}

/// One peer or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PeerWish {
    All,
    Only(PeerName),
}

impl FromStr for PeerWish {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "all" { Ok(Self::All) } else { s.parse().map(Self::Only) }
    }
}

/// How results are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Text,
    Json,
    Csv,
    Markdown,
    Svg,
}

impl Options {
    /// The format of the results; a table by default.
    pub const fn format(&self) -> Format {
        match self {
            Self { json: true, .. } => Format::Json,
            Self { csv: true, .. } => Format::Csv,
            Self { markdown: true, .. } => Format::Markdown,
            Self { svg: true, .. } => Format::Svg,
            _ => Format::Text,
        }
    }

    /// The scenes, each once.
    pub fn scenes(&self) -> Vec<SceneName> {
        let is_wished = |name: &SceneName| {
            self.scene.iter().any(|w| *w == SceneWish::All || *w == SceneWish::Only(*name))
        };
        SceneName::ALL.into_iter().filter(is_wished).collect()
    }

    /// The peers, each once.
    pub fn peers(&self) -> Vec<PeerName> {
        let is_wished = |name: &PeerName| {
            self.peers.iter().any(|w| *w == PeerWish::All || *w == PeerWish::Only(*name))
        };
        PeerName::ALL.into_iter().filter(is_wished).collect()
    }
}
