//! The plan: from statistics and capabilities to an engine, an encoding and a number of threads.
//!
//! A pure function, so that it is tested without a GPU and can explain itself. It predicts the
//! time of the whole frame, from boxes written to every pair iterated over by the client's threads, for
//! every engine that is available and every encoding ([`Calibration`] holds the constants), and takes
//! the least.

mod calibration;
mod explain;
mod memory;
mod model;
mod options;

pub use crate::engine::GpuCost;
pub use crate::stats::SceneStats;
pub use calibration::Calibration;
pub use memory::PlanMemory;
pub use options::CullOptions;

use self::model::Model;
use crate::engine::{CullInput, EngineChoice, EngineName};
use crate::floats;
use crate::mask::{Encoding, EncodingChoice};
use crate::precision::BoxSlice;

/// What can be used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capabilities {
    /// Threads for the CPU engines, at least 1.
    pub threads: usize,
    /// The GPU, if there is one.
    pub gpu: Option<GpuCost>,
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
    /// Predicted time of the whole frame, from boxes written to every pair iterated over, ns.
    pub predicted_ns: f64,
    /// The client's part of it, which iterates over the pairs, ns.
    pub iterate_ns: f64,
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
    /// Every engine that is available, in the order of [`EngineName::ALL`].
    pub candidates: [Option<Candidate>; EngineName::ALL.len()],
    /// What was asked for.
    pub options: CullOptions,
    /// What it was planned from.
    pub stats: SceneStats,
}

impl Plan {
    /// What the engine of the plan gets for these boxes, those that it was planned for.
    pub fn input<'a>(&self, boxes: impl Into<BoxSlice<'a>>) -> CullInput<'a> {
        let may_hand_over = self.options.engine == EngineChoice::Auto;
        let input = CullInput::boxes(boxes).encoding(self.encoding).threads(self.threads);
        input.may_hand_over(may_hand_over)
    }

    /// What the engine of the plan is expected to take, without the client's part, ns; 0 where it is no candidate.
    pub fn expected_ns(&self) -> u64 {
        let candidate = self.candidates[self.engine.ordinal()];
        candidate.map_or(0.0, |c| c.predicted_ns - c.iterate_ns) as u64
    }
}

/// Predictions that are larger by less than this share are the same: no prediction is as exact. The
/// engine that comes first in [`EngineName::ALL`] is taken then, so that small scenes keep the boxes'
/// own order.
const INDIFFERENT_SHARE: f64 = 0.05;

/// Chooses. Where the client forces an engine that is not available, the plan names it all the
/// same: that engine's own error says what is missing. The floating-point flags of this thread have no
/// say.
pub fn plan(
    stats: &SceneStats,
    capabilities: &Capabilities,
    calibration: &Calibration,
    options: &CullOptions,
) -> Plan {
    let model = Model { stats, capabilities, calibration, options };
    let candidates = floats::with_default(|| EngineName::ALL.map(|engine| model.candidate(engine)));
    let chosen = match options.engine {
        EngineChoice::Only(engine) => candidates.iter().flatten().find(|c| c.engine == engine),
        EngineChoice::Auto => {
            let times = candidates.iter().flatten().map(|c| c.predicted_ns);
            let least = times.fold(f64::INFINITY, f64::min);
            let most = floats::with_default(|| (1.0 + INDIFFERENT_SHARE) * least);
            candidates.iter().flatten().find(|c| c.predicted_ns <= most)
        }
    };
    let fallback = Candidate {
        engine: match options.engine {
            EngineChoice::Only(engine) => engine,
            EngineChoice::Auto => EngineName::CpuGrid,
        },
        encoding: match options.encoding {
            EncodingChoice::Only(encoding) => encoding,
            EncodingChoice::Auto => Encoding::Sparse,
        },
        threads: 1,
        predicted_ns: f64::INFINITY,
        iterate_ns: 0.0,
    };
    let Candidate { engine, encoding, threads, .. } = *chosen.unwrap_or(&fallback);
    Plan { engine, encoding, threads, candidates, options: *options, stats: *stats }
}

#[cfg(test)]
pub(crate) mod tests;
