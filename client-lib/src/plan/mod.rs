//! The plan: from statistics and capabilities to an engine, an encoding and a number of threads.
//!
//! A pure function, so that it is tested without a GPU and can explain itself. It predicts the
//! time of every engine that is to be had ([`Calibration`] holds the constants) and takes the
//! least.
//!
//! ```
//! use pairmask::engine::{EngineChoice, EngineName, Isa};
//! use pairmask::mask::EncodingChoice;
//! use pairmask::plan::{Calibration, Capabilities, SceneStats, Wishes, plan};
//! use pairmask::Aabb;
//!
//! let boxes: Vec<Aabb> = (0..100_000)
//!     .map(|i| {
//!         let (x, y, z) = ((i % 50) as f32, (i / 50 % 50) as f32, (i / 2500) as f32);
//!         Aabb::from([x, y, z, x + 0.5, y + 0.5, z + 0.5])
//!     })
//!     .collect();
//! let stats = SceneStats::of(&boxes, None);
//! let capabilities = Capabilities { threads: 2, gpu: None };
//! let calibration = Calibration::built_in(Isa::Avx512);
//! let plan = plan(&stats, &capabilities, &calibration, &Wishes::default());
//! assert_eq!(plan.engine, EngineName::CpuGrid);
//! println!("{}", plan.explain());
//! ```

mod calibration;
mod stats;

use std::fmt;

pub use calibration::{Calibration, GridCost, PairwiseCost};
pub use stats::SceneStats;

use crate::engine::{EngineChoice, EngineName};
use crate::mask::{Encoding, EncodingChoice};

/// What a GPU takes, measured when it was opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuCost {
    /// A frame of no boxes: submit, wait, read back, ns.
    pub fixed_ns: f64,
    /// Boxes up and the order down, ns a box.
    pub ns_a_box: f64,
    /// Each pair that all-pairs compares, ns.
    pub ns_a_test: f64,
    /// What the grid's stages take whatever the scene, more than those of all pairs, ns.
    pub grid_fixed_ns: f64,
    /// The grid's stages, ns a box; `None` where the GPU has no grid engine.
    pub grid_ns_a_box: Option<f64>,
    /// Each byte of the mask that comes down, ns.
    pub ns_a_reply_byte: f64,
}

/// What can be used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capabilities {
    /// Threads for the CPU engines, at least 1.
    pub threads: usize,
    /// The GPU, if there is one.
    pub gpu: Option<GpuCost>,
}

/// What the client asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wishes {
    /// An engine, or whichever is fastest.
    pub engine: EngineChoice,
    /// An encoding, or whichever is cheaper.
    pub encoding: EncodingChoice,
}

/// One way to cull a frame, and what it would take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The engine.
    pub engine: EngineName,
    /// The encoding that suits it.
    pub encoding: Encoding,
    /// Threads.
    pub threads: usize,
    /// Predicted time, ns.
    pub predicted_ns: f64,
}

/// What to do with a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// The engine.
    pub engine: EngineName,
    /// The encoding.
    pub encoding: Encoding,
    /// Threads, at least 1.
    pub threads: usize,
    /// Every engine that is to be had, in the order of [`EngineName::ALL`].
    pub candidates: [Option<Candidate>; EngineName::ALL.len()],
    /// What was asked for.
    pub wishes: Wishes,
    /// What it was planned from.
    pub stats: SceneStats,
}

/// Predictions this close are the same: less than the clock reads of a frame. The engine that comes
/// first in [`EngineName::ALL`] is taken then, so that tiny scenes keep the boxes' own order.
const INDIFFERENT_NS: f64 = 400.0;

/// Chooses. Where the client insists on an engine that is not to be had, the plan names it all the
/// same: that engine's own error says what is missing.
pub fn plan(
    stats: &SceneStats,
    capabilities: &Capabilities,
    calibration: &Calibration,
    wishes: &Wishes,
) -> Plan {
    let model = Model { stats, capabilities, calibration, wishes };
    let candidates = EngineName::ALL.map(|engine| model.candidate(engine));
    let chosen = match wishes.engine {
        EngineChoice::Only(engine) => candidates.iter().flatten().find(|c| c.engine == engine),
        EngineChoice::Auto => {
            let times = candidates.iter().flatten().map(|c| c.predicted_ns);
            let least = times.fold(f64::INFINITY, f64::min);
            candidates.iter().flatten().find(|c| c.predicted_ns <= least + INDIFFERENT_NS)
        }
    };
    let fallback = Candidate {
        engine: match wishes.engine {
            EngineChoice::Only(engine) => engine,
            EngineChoice::Auto => EngineName::CpuGrid,
        },
        encoding: match wishes.encoding {
            EncodingChoice::Only(encoding) => encoding,
            EncodingChoice::Auto => Encoding::Sparse,
        },
        threads: 1,
        predicted_ns: f64::INFINITY,
    };
    let Candidate { engine, encoding, threads, .. } = *chosen.unwrap_or(&fallback);
    Plan { engine, encoding, threads, candidates, wishes: *wishes, stats: *stats }
}

/// Counting and placing sparse words takes a GPU so much longer than packing a small dense mask:
/// 14.5 µs against 8.6 for both its stages at 1,000 boxes on an H200.
const GPU_SPARSE_STAGE_NS: f64 = 5_500.0;

/// The cost model of one frame.
struct Model<'a> {
    stats: &'a SceneStats,
    capabilities: &'a Capabilities,
    calibration: &'a Calibration,
    wishes: &'a Wishes,
}

impl Model<'_> {
    /// The cheapest way to run an engine, if it is to be had.
    fn candidate(&self, engine: EngineName) -> Option<Candidate> {
        let (cheapest_ns, threads) = match engine {
            EngineName::CpuBrute => self.on_threads(self.brute_ns()),
            EngineName::CpuSap => self.on_threads(self.sap_ns()),
            EngineName::CpuGrid => self.on_threads(self.grid_ns()),
            EngineName::GpuBrute => {
                (self.gpu_ns(|gpu| Some(gpu.ns_a_test * self.pairs_of_all()))?, 1)
            }
            EngineName::GpuGrid => {
                let grid_ns =
                    |gpu: &GpuCost| Some(gpu.grid_fixed_ns + gpu.grid_ns_a_box? * self.n());
                (self.gpu_ns(grid_ns)?, 1)
            }
        };
        let (encoding, encoding_ns) = self.encoding(engine);
        Some(Candidate { engine, encoding, threads, predicted_ns: cheapest_ns + encoding_ns })
    }

    fn n(&self) -> f64 {
        f64::from(self.stats.n.get())
    }

    fn pairs_of_all(&self) -> f64 {
        self.stats.n.pair_count() as f64
    }

    fn brute_ns(&self) -> f64 {
        self.pairwise_ns(&self.calibration.brute, self.n(), self.pairs_of_all())
    }

    fn sap_ns(&self) -> f64 {
        let solid = self.n() * f64::from(self.stats.solid_share);
        // A strip is tested whole, so that a window costs half a strip more than it holds.
        let window = solid * f64::from(self.stats.window_share) + 8.0;
        // The radix passes touch more memory than the caches hold from here on.
        let spill = if self.n() > 3.0e5 { 2.0 } else { 1.0 };
        self.pairwise_ns(&self.calibration.sap, spill * self.n(), solid * window)
    }

    fn pairwise_ns(&self, cost: &PairwiseCost, boxes: f64, tests: f64) -> f64 {
        let compared = cost.ns_a_test * tests + cost.ns_a_pair * self.stats.expected_pairs();
        cost.fixed_ns + cost.ns_a_box * boxes + compared.min(cost.ns_a_test_most * tests)
    }

    fn grid_ns(&self) -> f64 {
        let cost = &self.calibration.grid;
        let spread = f64::from(self.stats.large_size / self.stats.median_size);
        let doublings = if spread.is_finite() { spread.max(1.0).log2() } else { 0.0 };
        let levels = if doublings > 1.0 { cost.levels_ns } else { 0.0 };
        let rods = f64::from((self.stats.elongation - 2.0).max(0.0));
        let a_box = cost.ns_a_box
            + cost.ns_a_size_doubling * doublings.min(4.0)
            + cost.ns_a_elongation * rods;
        cost.fixed_ns + levels + a_box * self.n()
    }

    fn gpu_ns(&self, execute: impl Fn(&GpuCost) -> Option<f64>) -> Option<f64> {
        let gpu = self.capabilities.gpu.as_ref()?;
        let reply_bytes = 4.0 * self.n() + 12.0 * self.stats.expected_pairs();
        Some(
            gpu.fixed_ns
                + gpu.ns_a_box * self.n()
                + execute(gpu)?
                + gpu.ns_a_reply_byte * reply_bytes,
        )
    }

    /// One thread or all of them.
    fn on_threads(&self, one_ns: f64) -> (f64, usize) {
        let threads = self.capabilities.threads.max(1);
        let speed_up = 1.0 + self.calibration.thread_gain * (threads as f64 - 1.0);
        let all_ns = one_ns / speed_up + self.calibration.thread_fixed_ns;
        if threads > 1 && all_ns < one_ns { (all_ns, threads) } else { (one_ns, 1) }
    }

    /// The encoding that was asked for, or the cheaper one, and what it costs.
    fn encoding(&self, engine: EngineName) -> (Encoding, f64) {
        let in_box_order = matches!(engine, EngineName::CpuBrute | EngineName::GpuBrute);
        let pairs = self.stats.expected_pairs();
        let scatter = if in_box_order { 0.0 } else { self.calibration.ns_a_scattered_pair };
        let dense_bytes = 4.0 * self.stats.n.dense_words() as f64;
        let dense_ns = self.calibration.ns_a_dense_byte * dense_bytes + scatter * pairs;
        let stage_ns = if engine.is_gpu() { GPU_SPARSE_STAGE_NS } else { 0.0 };
        let sparse_ns = stage_ns + self.calibration.ns_a_sparse_pair * pairs;
        match self.wishes.encoding {
            EncodingChoice::Only(Encoding::Dense) => (Encoding::Dense, dense_ns),
            EncodingChoice::Auto if dense_ns < sparse_ns => (Encoding::Dense, dense_ns),
            EncodingChoice::Only(Encoding::Sparse) | EncodingChoice::Auto => {
                (Encoding::Sparse, sparse_ns)
            }
        }
    }
}

impl Plan {
    /// Why, in a few lines for a terminal.
    pub fn explain(&self) -> impl fmt::Display + '_ {
        Explanation(self)
    }
}

struct Explanation<'a>(&'a Plan);

impl fmt::Display for Explanation<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Plan { engine, encoding, threads, candidates, wishes, stats } = self.0;
        writeln!(
            f,
            "{} boxes, {:.0} % solid, median size {}, 90 % below {}, sweep window {:.3} % of them, elongation {:.1}, {:.0} pairs expected",
            stats.n.get(),
            100.0 * stats.solid_share,
            stats.median_size,
            stats.large_size,
            100.0 * stats.window_share,
            stats.elongation,
            stats.expected_pairs(),
        )?;
        for candidate in candidates.iter().flatten() {
            let mark = if candidate.engine == *engine { "->" } else { "  " };
            writeln!(
                f,
                "{mark} {:<10} {:<6} {} threads  {:>12.1} µs predicted",
                candidate.engine.as_str(),
                candidate.encoding.as_str(),
                candidate.threads,
                candidate.predicted_ns / 1e3,
            )?;
        }
        let why = match wishes.engine {
            EngineChoice::Auto => "least predicted time",
            EngineChoice::Only(_) => "asked for",
        };
        write!(f, "{engine}, {encoding}, {threads} threads: {why}")
    }
}

#[cfg(test)]
mod tests;
