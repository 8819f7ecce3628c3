//! Cases, a scene of some size each, that are culled in several ways, interleaved.

mod case;
mod threads;
mod timed_way;

pub use case::{Case, CaseTimes, Effort, WaySet, measure};
pub use threads::{Pools, core_count, thread_counts};
pub use timed_way::{Way, WayTimes};

use pairmask_core::engine::{CullError, EngineName};
use pairmask_core::mask::MaskError;

use pairmaskd::scene::SceneName;

/// Why a measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// An engine failed.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// The system started no threads.
    #[error("the engines' threads cannot be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// An engine is broken: its mask is malformed.
    #[error("a mask cannot be read: {0}: please report this")]
    Mask(#[from] MaskError),
    /// An engine is broken: its count of pairs is not the number of bits in its mask.
    #[error("{engine} counted {counted} pairs and its mask holds {decoded}: please report this")]
    Miscounted {
        /// The engine.
        engine: EngineName,
        /// Pairs that it counted.
        counted: u64,
        /// Pairs in its mask.
        decoded: u64,
    },
    /// An engine is broken: two engines find different numbers of pairs.
    #[error(
        "{first} finds {pairs} pairs in {n} boxes of {scene} and {second} {other}: please report this"
    )]
    Disagree {
        /// The scene.
        scene: SceneName,
        /// Boxes.
        n: usize,
        /// One engine.
        first: EngineName,
        /// Its pairs.
        pairs: u64,
        /// The other.
        second: EngineName,
        /// Its pairs.
        other: u64,
    },
}
