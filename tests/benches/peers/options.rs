//! The command line.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Parser, ValueEnum};
use pairmask_core::EngineChoice;
use pairmask_core::engine::UnknownName;
use pairmask_tests::peers::line::PeerName;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::SceneName;

/// The daemon and the in-process engines against other broad phases.
///
/// All contenders see the same frames, in one process, in turns. A turn is a few frames, the first
/// of which is not counted (the others' turns have emptied the caches), and the order rotates.
/// Boxes move 2 % of their size a frame.
///
/// Time of a frame: from the user's boxes to all pairs iterated over. For us: write the boxes into the
/// session's memory (also a column of its own), submit, wait, decode. For the others: update from the
/// boxes, then iterate over every pair. Iterating counts and sums. Sets of pairs are compared by themselves,
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
pub struct Options {
    /// Scenes, or `all`
    #[arg(long, value_name = "NAME,..", default_value = "uniform,mixed,pile,plane")]
    pub scene: Scenes,
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
    /// Peers
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = PeerName::value_variants())]
    pub peers: Vec<PeerName>,
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
    /// Print one JSON object a peer and line
    #[arg(long)]
    pub json: bool,
    /// Print Markdown
    #[arg(long, conflicts_with = "json")]
    pub markdown: bool,
    /// Write peers.jsonl and peers.md there too
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Instead of frames: known oddities, then for so many seconds a search for scenes in which the plan's engine is
    /// slowest beside parry3d, in process, by the first of the sizes and the last of the threads
    #[arg(long, value_name = "SECONDS")]
    pub search: Option<u64>,
    /// Seed of the scenes
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Debug)]
pub struct Scenes(pub Vec<SceneName>);

impl FromStr for Scenes {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "all" {
            return Ok(Self(SceneName::ALL.into()));
        }
        Ok(Self(s.split(',').map(str::parse).collect::<Result<_, _>>()?))
    }
}
